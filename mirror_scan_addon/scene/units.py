"""A scene's units: what a Blender unit is in metres, and sizes as the user wants to read them.

core knows metres only. Objects, and properties of ``unit="LENGTH"``, are in Blender units as all of Blender is.
Errors and residuals are always shown in millimetres.
"""

from __future__ import annotations

import bpy

INCH, CUBIC_FOOT = 0.0254, 28.316847  # [m], [l]
CHOSEN = {"CENTIMETERS": ("cm", 0.01, 1), "MILLIMETERS": ("mm", 0.001, 0), "INCHES": ("in", INCH, 1)}
"""What a user chose for lengths in the scene: symbol, metres, decimals. Metres and feet, which Blender sets by itself,
and those for other things than people, are left to the size."""


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """Metres in a Blender unit of that scene. Blender leaves *Unit Scale* aside where the unit system is *None*."""
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else units.scale_length


def length_text(metres: float, scene: bpy.types.Scene) -> str:
    """A length in the unit that the scene shows lengths in."""
    units = scene.unit_settings
    if units.system != "NONE" and units.length_unit in CHOSEN:
        symbol, size, digits = CHOSEN[units.length_unit]
        return f"{metres / size:.{digits}f} {symbol}"
    if units.system == "IMPERIAL":
        inches = metres / INCH
        return f"{int(round(inches) // 12)}' {round(inches) % 12}\"" if inches >= 11.5 else f'{inches:.1f}"'
    return f"{metres:.2f} m" if metres >= 1.0 else f"{100 * metres:.1f} cm"


def area_text(square_metres: float, scene: bpy.types.Scene) -> str:
    """A small area: in square centimetres, or square inches."""
    if scene.unit_settings.system == "IMPERIAL":
        return f"{square_metres / INCH**2:.1f} in²"
    return f"{1e4 * square_metres:.0f} cm²"


def volume_text(litres: float, scene: bpy.types.Scene) -> str:
    """A volume: in litres, or cubic feet."""
    if scene.unit_settings.system == "IMPERIAL":
        return f"{litres / CUBIC_FOOT:.2f} ft³"
    return f"{litres:.1f} l"
