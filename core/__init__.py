"""Mirror Scan's algorithms, in numpy and numba; nothing here knows Blender.

``__all__`` lists the packages in the order in which data flows: each imports only from those before it. What a package
hands on, and which of its modules others may import, stands in its own ``__all__``. CONTRIBUTING.md has the map;
``tests/test_architecture.py`` holds the rules. Importing a package brings no numba but where kernels are called.
"""

__all__ = [
    "errors",
    "numeric",
    "camera",
    "mesh",
    "io",
    "capture",
    "depth",
    "mirrors",
    "views",
    "mirror_detection",
    "mirror_alignment",
    "subject",
    "light",
    "patches",
    "hole_filling",
    "zippering",
    "closing",
    "checks",
    "registration",
    "avatar",
    "motion",
    "texture",
    "decimation",
    "printing",
    "measurements",
    "clothes",
    "preview",
    "pipeline",
    "cluster",
    "batches",
    "sequences",
    "guidance",
    "simulation",
    "rig_planning",
    "experiments",
    "cli",
]
