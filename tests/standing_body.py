"""A mannequin and where its joints are, by the numbers it is drawn with, for tests of skeletons and weights."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.avatar.skeleton import BONES, ENDS, Skeleton
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import Figure, mannequin


def standing_body(arm_angle: float = 45.0, leg_spread: float = 9.0, resolution: float = 0.014) -> tuple[Mesh, Skeleton]:
    """A mannequin 1.70 m tall and its skeleton; arms ``arm_angle`` degrees below the horizontal."""
    figure = Figure(arm_angle_deg=arm_angle, leg_spread_deg=leg_spread, elbow_bend_deg=0.0)
    return mannequin(1.70, figure, resolution), skeleton_of(arm_angle, leg_spread)


def skeleton_of(arm_angle: float, leg_spread: float) -> Skeleton:
    at = {
        "Hips": (0, 0.01, 0.95), "Spine": (0, 0.0, 1.04), "Spine1": (0, 0.0, 1.14), "Spine2": (0, 0.02, 1.26),
        "Neck": (0, 0.022, 1.43), "Head": (0, 0.006, 1.51), "HeadTop_End": (0, 0.018, 1.69),
    }  # fmt: skip
    down = np.radians(arm_angle)
    along = np.array([np.cos(down), 0.0, -np.sin(down)])
    leg = np.array([np.tan(np.radians(leg_spread)), 0.0, -1.0])
    shoulder, hip = np.array([0.172, 0.016, 1.375]), np.array([0.088, 0.005, 0.875])
    ankle = hip + 0.79 * leg + (0, 0.016, 0)
    toes_out = np.radians(7.0 + 0.5 * leg_spread)
    ahead = np.array([np.sin(toes_out), -np.cos(toes_out), 0.0])
    left = {
        "Shoulder": np.array([0.05, 0.02, 1.42]), "Arm": shoulder, "ForeArm": shoulder + 0.272 * along,
        "Hand": shoulder + 0.507 * along, "Hand_End": shoulder + 0.68 * along, "UpLeg": hip,
        "Leg": hip + 0.387 * leg - (0, 0.008, 0), "Foot": ankle, "ToeBase": ankle + 0.11 * ahead - (0, 0, 0.06),
        "Toe_End": ankle + 0.16 * ahead - (0, 0, 0.065),
    }  # fmt: skip
    at |= {f"Left{name}": place for name, place in left.items()}
    at |= {f"Right{name}": place * (-1, 1, 1) for name, place in left.items()}
    return Skeleton(np.array([at[name] for name in BONES]), np.array([at[name] for name in ENDS]), np.ones(len(BONES)))
