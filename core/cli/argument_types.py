"""What an option's text means: numbers within bounds, sizes, pixels, lists; each a type for argparse."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable

from ..rig_planning.rooms import MIRRORS, ROOMS

OPTICS = ("ideal", "real")
EFFECTS = ("multipath", "glass", "bow", "attenuation", "dark", "skin", "noise", "warp", "color", "uneven")
TEXTURE_SIZE = 2048
"""Width and height of a texture unless another is asked for [px]."""


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """A whole number within bounds."""

    def read(text: str) -> int:
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be from {low} to {high}, not {value}")
        return value

    read.__name__ = "whole number"
    return read


def millimetres(low: float, high: float) -> Callable[[str], float]:
    """A length within bounds [mm]."""

    def read(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be from {low} to {high} mm, not {text}")
        return value

    read.__name__ = "length in millimetres"
    return read


def seconds(text: str) -> float:
    """A time from 0 to 60 s."""
    value = float(text)
    if not 0.0 <= value <= 60.0:
        raise argparse.ArgumentTypeError(f"{text} is not within 0 to 60")
    return value


seconds.__name__ = "number of seconds"  # argparse names the type when it cannot be read


def gigabytes(text: str) -> float:
    """Memory, from 0.5 GB on."""
    value = float(text)
    if not 0.5 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"must be from 0.5 GB on, not {text}")
    return value


gigabytes.__name__ = "number of gigabytes"


def image_size(text: str) -> tuple[int, int]:
    """Width and height, as 848x480."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 4096 and 0 < int(height) <= 4096):
        raise argparse.ArgumentTypeError(f"must be as 848x480, not {text}")
    return int(width), int(height)


def _metres(text: str, count: int) -> tuple[float, ...]:
    """Lengths joined by x; ArgumentTypeError."""
    try:
        values = tuple(float(part) for part in re.split("[x×]", text.lower()))
    except ValueError:
        values = ()
    if len(values) != count or not all(0.0 < value <= 50.0 for value in values):
        example = "3x3.5x2.4" if count == 3 else "0.8x1.75"
        raise argparse.ArgumentTypeError(f"'{text}' is not {count} lengths in metres such as {example}")
    return values


def room_size(text: str) -> tuple[float, ...]:
    """Width, depth and height of a room [m], or its name."""
    room = ROOMS.get(text)
    return _metres(text, 3) if room is None else (room.width, room.depth, room.height)


def glass_size(text: str) -> tuple[float, ...]:
    """Width and height of a mirror's glass [m], or its name."""
    return MIRRORS[text] if text in MIRRORS else _metres(text, 2)


def texture_size(text: str) -> int:
    """Width of a texture, as 2048 or 2K."""
    size = 1024 * int(text[:-1]) if text[-1:] in "kK" else int(text)
    if not 256 <= size <= 8192:
        raise argparse.ArgumentTypeError(f"must be from 256 to 8192 pixels, or 1K to 8K, not {text}")
    return size


texture_size.__name__ = "size in pixels"


def with_explicit_sizes(arguments: list[str]) -> list[str]:
    """Arguments in which ``--texture`` without a size has one: argparse would take the next argument for it."""
    explicit = []
    for here, after in zip(arguments, [*arguments, ""][1:], strict=True):
        bare = here == "--texture" and not re.fullmatch(r"\d+[kK]?", after)
        explicit.append(f"--texture={TEXTURE_SIZE}" if bare else here)
    return explicit


def pixel(text: str) -> tuple[float, float]:
    """A pixel as column,row."""
    u, v = (float(part) for part in text.split(","))
    if not math.isfinite(u) or not math.isfinite(v):
        raise argparse.ArgumentTypeError(f"must be two numbers, column,row, not {text}")
    return u, v


pixel.__name__ = "pixel as column,row"


def optics(text: str) -> str:
    """Ideal, real, or effects separated by commas."""
    if text not in OPTICS and not set(text.split(",")) <= set(EFFECTS):
        raise argparse.ArgumentTypeError(f"must be ideal, real, or some of {','.join(EFFECTS)}; not {text}")
    return text


def counts(text: str) -> tuple[int, ...]:
    """Numbers of triangles, separated by commas."""
    return tuple(whole_number(100, 10_000_000)(part) for part in text.split(","))


counts.__name__ = "list of whole numbers"


def frequencies(text: str) -> tuple[float, ...]:
    """Frequencies from 1 to 1000 MHz, separated by commas."""
    values = tuple(float(part) for part in text.split(","))
    if not all(1 <= value <= 1000 for value in values):
        raise argparse.ArgumentTypeError(f"must be from 1 to 1000 MHz, separated by commas, not {text}")
    return values


frequencies.__name__ = "list of frequencies"


def percentages(text: str) -> tuple[float, ...]:
    """Percentages from 0 to below 100, separated by commas."""
    values = tuple(float(part) for part in text.split(","))
    if not all(0 <= value < 100 for value in values):
        raise argparse.ArgumentTypeError(f"must be from 0 to below 100, separated by commas, not {text}")
    return values


percentages.__name__ = "list of percentages"


def sways(text: str) -> tuple[float, ...]:
    """Lengths from 0 to 100 mm, separated by commas."""
    values = tuple(float(part) for part in text.split(","))
    if not all(0 <= value <= 100 for value in values):
        raise argparse.ArgumentTypeError(f"must be from 0 to 100, separated by commas, not {text}")
    return values


sways.__name__ = "list of lengths"


def turn(text: str) -> float:
    """An angle from one capture to the next [degrees]."""
    value = float(text)
    if not 1.0 <= abs(value) <= 180.0:
        raise argparse.ArgumentTypeError(f"must be from 1 to 180 degrees either way, not {text}")
    return value


turn.__name__ = "angle"
