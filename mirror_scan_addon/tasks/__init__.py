"""The jobs that take long, as generator functions that need no bpy: any process may run them.

They take and give plain values, arrays and core's plain records (Intrinsics, Mesh), so that handing them over imports
nothing heavy: numba stays out of Blender's window. Mirrors go as *records*, the plain form that a scene keeps:
``{"name", "picks", "source", "plane", "residual_mm", "message"}``.
"""

from .avatars import (
    dress_steps,
    garment_weight_steps,
    measure_steps,
    motion_steps,
    reduce_steps,
    skeleton_steps,
    texture_steps,
)
from .captures import live_steps, load_steps, record_steps
from .mirror_records import mirror_of, record_of
from .mirrors import calibrate_steps, find_mirrors_steps, fit_steps, rig_steps
from .reconstruction import (
    PICTURE_SIZE,
    SCAN_SHARES,
    build_steps,
    check_steps,
    find_subject_steps,
    picture_steps,
    scan_steps,
)
from .results import (
    Built,
    Checked,
    Cloud,
    Fitted,
    Loaded,
    Measured,
    RigChecked,
    Rigged,
    Scanned,
    Simulated,
    Source,
    Steps,
    Subject,
    Textured,
)
from .virtual_rigs import check_rig_steps, find_rig_steps, mannequin_steps, plan_steps, sample_steps, simulate_steps

__all__ = [
    "Built",
    "Checked",
    "Cloud",
    "Fitted",
    "Loaded",
    "Measured",
    "PICTURE_SIZE",
    "RigChecked",
    "Rigged",
    "SCAN_SHARES",
    "Scanned",
    "Simulated",
    "Source",
    "Steps",
    "Subject",
    "Textured",
    "build_steps",
    "calibrate_steps",
    "check_rig_steps",
    "check_steps",
    "dress_steps",
    "find_mirrors_steps",
    "find_rig_steps",
    "find_subject_steps",
    "fit_steps",
    "garment_weight_steps",
    "live_frames",
    "live_steps",
    "load_steps",
    "mannequin_steps",
    "measure_steps",
    "mirror_of",
    "motion_steps",
    "picture_steps",
    "plan_steps",
    "record_of",
    "record_steps",
    "reduce_steps",
    "rig_steps",
    "sample_steps",
    "scan_steps",
    "simulate_steps",
    "skeleton_steps",
    "texture_steps",
]
