"""An avatar that follows a tracker in Blender: what a frame costs, drawing aside.

``python -m benchmarks.rig_follow`` prints the table alone; it needs the bpy module.
"""

from __future__ import annotations

import time

import numpy as np

from .results import Finding, Result, Table, number

MOST_MILLISECONDS = 40.0
_RESOLUTIONS = (0.0125, 0.0085)  # of the mannequin [m]: about as many vertices as a scan of an Azure Kinect, and twice


def run() -> Result:
    """Time a pose and the evaluation of the mesh, for a round of each of our clips."""
    import bpy
    import mirror_scan
    from mirror_scan.core.avatar.skin_weights import skinned_mesh
    from mirror_scan.core.motion import CLIPS, PoseFollower, make_clip
    from mirror_scan.core.simulation.mannequin import rigged_mannequin

    mirror_scan.register()
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects

    rows, slowest = [], 0.0
    for resolution in _RESOLUTIONS:
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        body, skeleton = rigged_mannequin(resolution=resolution)
        mesh, weights = skinned_mesh(body, skeleton)
        scene = bpy.context.scene
        avatar = avatar_objects.create_avatar(mesh, collection=scene.collection)
        bones = armature.add_armature(avatar, skeleton, weights, scene.collection)
        follower, posing, evaluating = PoseFollower(skeleton), [], []
        for name in CLIPS:
            for joints in make_clip(name, skeleton).joints(skeleton):
                started = time.perf_counter()
                armature.show_pose(bones, follower.follow(joints))
                posed = time.perf_counter()
                bpy.context.view_layer.update()
                avatar.evaluated_get(bpy.context.evaluated_depsgraph_get())
                posing.append(posed - started)
                evaluating.append(time.perf_counter() - posed)
        both = 1e3 * (np.array(posing) + np.array(evaluating))
        slowest = max(slowest, float(np.quantile(both, 0.95)))
        rows.append((f"{len(mesh.vertices):,}", str(len(both)), number(1e3 * np.median(posing), 2),
                     number(1e3 * np.median(evaluating), 1), number(np.median(both), 1),
                     number(np.quantile(both, 0.95), 1)))  # fmt: skip
    columns = ("vertices", "frames", "pose", "evaluation", "both, median", "both, 95 %")
    table = Table("Following a tracker in Blender: a frame, drawing aside [ms]", columns, rows)
    table.notes.append(f"bpy {bpy.app.version_string}; a round of each of our clips.")
    limit = f"Follow Stream: pose and evaluation <= {MOST_MILLISECONDS:g} ms a frame (95 %)"
    return Result([table], [Finding(limit, f"{slowest:.1f} ms", slowest <= MOST_MILLISECONDS)])


if __name__ == "__main__":
    print(run().tables[0].text())
