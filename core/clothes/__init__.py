"""Clothes: garments cut to an avatar's body, with weights and pins."""

from .tailoring import KINDS, LAYER, NAMES, make_garment

__all__ = [
    "KINDS",
    "LAYER",
    "NAMES",
    "body_distance",
    "make_garment",
    "tailoring",
    "weight_transfer",
]
