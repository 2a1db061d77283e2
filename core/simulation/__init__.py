"""A virtual range camera in a room with mirrors, and somebody to scan: demo, tests and ground truth.

``mannequin`` makes the body, ``scene`` describes the rig, ``sensors`` how a depth camera errs, ``rays`` traces the
light, ``simulate`` puts them together and writes the RGB-D folder.
"""

__all__ = ["coverage", "mannequin", "props", "rays", "scene", "sensors", "simulate"]
