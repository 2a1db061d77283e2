"""How an avatar is printed, and what a printer can do."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import MirrorScanError


@dataclass(frozen=True)
class PrintSettings:
    """What is made of an avatar; by default it is printed as it is, at its true size.

    Parameters
    ----------
    height_mm : float or None
        Height of the person in print, without the plate [mm]; None takes ``scale``.
    scale : float
        Size in print by true size, such as 0.1 for 1 : 10.
    wall_mm : float
        Thickness of the wall of a hollow print [mm]; 0 = solid.
    base_mm : float
        Thickness of a plate under the feet [mm]; 0 = none.
    margin_mm : float
        How far the plate reaches beyond the feet [mm]; 0 = automatic, 4 % of the height.
    drain_mm : float
        Diameter of holes from below into a hollow print [mm], two where there is room: resin and powder must get out.
        0 = none.
    """

    height_mm: float | None = None
    scale: float = 1.0
    wall_mm: float = 0.0
    base_mm: float = 0.0
    margin_mm: float = 0.0
    drain_mm: float = 0.0

    def check(self) -> None:
        """Refuse what makes no sense.

        Raises
        ------
        MirrorScanError
        """
        if self.height_mm is not None and not 1 <= self.height_mm <= 10_000:
            raise MirrorScanError(
                "a print {height:g} mm high is not possible; give 1 to 10000 mm", height=self.height_mm
            )
        if not 0 < self.scale <= 100:
            raise MirrorScanError("a scale of {scale:g} is not possible; give more than 0, up to 100", scale=self.scale)
        for name, value in (("wall", self.wall_mm), ("plate", self.base_mm), ("margin", self.margin_mm),
                            ("drain hole", self.drain_mm)):  # fmt: skip
            if not 0 <= value <= 1000:
                raise MirrorScanError(
                    "a {name} of {value:g} mm is not possible; give 0 or more", name=name, value=value
                )
        if self.drain_mm and not self.wall_mm:
            raise MirrorScanError("drain holes need a hollow print; give the thickness of its wall too")


@dataclass(frozen=True)
class PrintLimits:
    """What a printer can do.

    Parameters
    ----------
    wall_mm : float
        Thinnest that it prints reliably [mm]: twice the nozzle for filament, about 0.6 for resin.
    volume_mm : tuple of float or None
        Width, depth and height it has room for [mm]; None is not checked.
    step_mm : float
        What begins in mid-air and is lower than this needs no support [mm].
    """

    wall_mm: float = 0.8
    volume_mm: tuple[float, float, float] | None = None
    step_mm: float = 1.0
