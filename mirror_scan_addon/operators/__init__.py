"""Operators, one topic per file. numpy and the stages of core are imported only when a button is pressed."""

from __future__ import annotations

import bpy

from . import (
    build_avatar,
    cancel_job,
    check,
    color_by,
    compiled_code,
    dress,
    errors,
    export_avatar,
    find_subject,
    follow_stream,
    help,
    import_sequence,
    live_view,
    load_capture,
    measure,
    mirrors,
    motion,
    pick_mirror_points,
    pick_subject,
    reduce,
    rig,
    rig_file,
    room,
    sample_capture,
    scan_to_avatar,
    skeleton,
    studio,
    texture,
)

_modules = (
    scan_to_avatar, load_capture, errors, room, mirrors, pick_mirror_points, rig_file, find_subject, pick_subject,
    build_avatar, check, color_by, skeleton, motion, texture, reduce, measure, dress, follow_stream, export_avatar,
    import_sequence, live_view, studio, rig, sample_capture, help, compiled_code, cancel_job,
)  # fmt: skip

register, unregister = bpy.utils.register_classes_factory(tuple(kind for module in _modules for kind in module.CLASSES))
