"""Objects of a loaded capture: its point cloud and camera, shown and taken away."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy

from . import live_subject, scan_records
from .preferred import begin_with_preferences
from .units import metres_per_unit

STANDS = "mirror_scan_stands"
"""Custom property of a capture's points: where the frame stands in which its avatar is made, along x [m]."""


def show_capture(context: bpy.types.Context, target: bpy.types.Scene, loaded, beside: bool = True) -> bpy.types.Object:
    """Put a loaded capture into a scene, in place of the one before; beside the avatars of others, unless its camera is
    one of the scene's."""
    from ...core.camera import unproject
    from . import avatar_objects, avatar_places, point_cloud, scan_collections

    settings = target.mirror_scan
    source = _source_of(loaded.info)
    path, name = source["path"], source["name"]
    unit, placement = metres_per_unit(target), loaded.placement
    if beside:
        seen = unproject(loaded.depth, loaded.intrinsics)[loaded.depth > 0]
        placement = avatar_places.place_of_points(target, source, seen, loaded.placement, unit)
    with avatar_objects.discard_on_error() as made:
        made.append(point_cloud.create_picture(f"{name} depth", loaded.depth_picture))
        if loaded.color is not None:
            made.append(point_cloud.create_picture(f"{name} colour", loaded.color))
        points = point_cloud.create_cloud(
            f"{name} Points", loaded.depth, loaded.color, loaded.intrinsics, loaded.info, placement, None, unit,
        )  # fmt: skip
    if avatar_places.avatar_from(target, source) is None:
        points[STANDS] = float(placement[0, 3] - loaded.placement[0, 3])
    forget_capture(target)
    scan = scan_collections.scan_of(target, path, name)
    home = scan_collections.part_of(scan, scan_collections.POINTS)
    home.objects.link(points)
    # after the one before is gone, which may have held them
    points.name = points.data.name = f"{scan.name} Points"
    for image, kind in zip(made, ("depth", "colour"), strict=False):
        image.name = f"{scan.name} {kind}"
    for layer in target.view_layers:
        layer.update()
        if points.name not in layer.objects:
            scan_collections.show_in_layer(home, layer)
    scan_collections.tidy(target)
    settings.cloud, settings.depth_image = points, made[0]
    settings.color_image = made[1] if loaded.color is not None else None
    for image in made:
        image.preview_ensure()
    scan_records.set_records(settings, loaded.mirrors)
    settings.mirror_index = 0
    if loaded.seen is not None:
        point_cloud.set_values(points.data, seen=loaded.seen)
    settings.cloud_colors, settings.show_cloud, settings.fold = "CAPTURE", True, False
    settings.subject.property_unset("clicked")  # which, unlike setting it, asks for no search
    live_subject.forget(target)
    scan_records.forget_subject(settings)
    begin_with_preferences(settings)
    if target == context.scene:
        avatar_objects.select_only(context, points)
        points.select_set(False, view_layer=context.view_layer)  # its box would draw the eye
    return points


def place_on_found(target: bpy.types.Scene, points: bpy.types.Object, placement) -> None:
    """Move a capture's points with the person that was found, whose frame ``placement`` (4, 4), camera frame → avatar
    frame [m], gives; those that stand on their avatar stay there."""
    import numpy as np

    from . import avatar_places, point_cloud

    if avatar_places.avatar_from(target, _source_of(point_cloud.cloud_info(points))) is None:
        beside = np.eye(4)
        beside[0, 3] = float(points.get(STANDS, 0.0))  # files of older versions hold none
        point_cloud.place(points, beside @ placement, metres_per_unit(target))


def _source_of(info: dict) -> dict:
    """``path`` and ``name`` of a capture, by what is known of it."""
    from . import scan_collections

    path = str(info.get("path", ""))
    return {"path": path, "name": scan_collections.capture_name(path) if path else str(info.get("name", ""))}


def forget_capture(target: bpy.types.Scene) -> None:
    """Remove the scene's cloud and pictures, unless another scene or object uses them."""
    from .point_cloud import is_cloud

    settings = target.mirror_scan
    cloud, images = settings.cloud, (settings.color_image, settings.depth_image)
    settings.cloud = settings.color_image = settings.depth_image = None
    if is_cloud(cloud) and cloud.library is None and set(cloud.users_scene) <= {target}:
        mesh = cloud.data
        bpy.data.objects.remove(cloud)
        if mesh is not None and not mesh.users:
            bpy.data.meshes.remove(mesh)
    for image in images:
        if image is not None and image.library is None and not image.users:
            bpy.data.images.remove(image)
