"""A virtual range camera in a room with mirrors, and a person to scan: demo, tests and ground truth.

``mannequin`` makes the body, ``scene`` describes the rig, ``sensors`` a depth camera's noise, ``optics`` what light
and glass do besides, ``rays`` traces the light, ``returned_light`` is what surfaces give back of it, ``multipath`` adds
it up, ``simulate`` puts them together and writes the RGB-D folder.
"""

__all__ = [
    "coverage",
    "mannequin",
    "multipath",
    "optics",
    "props",
    "rays",
    "returned_light",
    "scene",
    "sensors",
    "simulate",
]
