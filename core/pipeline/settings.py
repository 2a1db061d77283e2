"""Every stage's settings, gathered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..closing.mesh_closing import ClosingSettings
from ..depth.settings import DepthSettings
from ..light.two_way_light import LightSettings
from ..mirror_alignment.floor_alignment import FloorSettings
from ..mirror_alignment.glass_alignment import BowSettings, ThicknessSettings
from ..mirror_alignment.own_reflection import OwnReflectionSettings
from ..mirror_alignment.person_alignment import PersonSettings
from ..mirror_alignment.reflection_alignment import JointSettings
from ..mirror_alignment.seam_alignment import SeamSettings
from ..mirror_alignment.seam_glass import SeamGlassSettings
from ..mirror_alignment.view_alignment import AgreementSettings
from ..mirror_detection.edge_segments import DetectionSettings
from ..mirrors.picked_mirror import MirrorSettings
from ..patches.grid_triangulation import TriangulationSettings
from ..patches.outline_colors import ColorSettings
from ..patches.view_comparison import OverlapSettings
from ..subject.subject_views import ViewSettings
from ..zippering.zipper import ZipperSettings

if TYPE_CHECKING:
    from ..texture import TextureSettings


@dataclass(frozen=True)
class Settings:
    """Every stage's settings; the defaults work.

    ``skeleton``: the avatar gets joints and skin weights. ``measure``: the body is measured. ``triangles``: how many
    the avatar is reduced to; None leaves them. ``texture``: how it is made; None makes none.
    """

    depth: DepthSettings = DepthSettings()
    mirror: MirrorSettings = MirrorSettings()
    detection: DetectionSettings = DetectionSettings()
    alignment: JointSettings = JointSettings()
    floor: FloorSettings = FloorSettings()
    person: PersonSettings = PersonSettings()
    agreement: AgreementSettings = AgreementSettings()
    own_reflection: OwnReflectionSettings = OwnReflectionSettings()
    bow: BowSettings = BowSettings()
    thickness: ThicknessSettings = ThicknessSettings()
    views: ViewSettings = ViewSettings()
    light: LightSettings = LightSettings()
    triangulation: TriangulationSettings = TriangulationSettings()
    colors: ColorSettings = ColorSettings()
    overlap: OverlapSettings = OverlapSettings()
    zipper: ZipperSettings = ZipperSettings()
    seams: SeamSettings = SeamSettings()
    seam_glass: SeamGlassSettings = SeamGlassSettings()
    closing: ClosingSettings = ClosingSettings()
    skeleton: bool = False
    measure: bool = False
    triangles: int | None = None
    texture: TextureSettings | None = None
