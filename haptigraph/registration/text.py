"""Write registrations as TOML: anatomy in pixels in, text out. Readers check it."""

import base64
from collections.abc import Sequence
from textwrap import wrap

from msgspec import Struct

from haptigraph.geometry import Vec
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.lens import Lens
from haptigraph.projection import Homography, ImageMap, image_map
from haptigraph.registration.depth import DepthPlane, depth_table
from haptigraph.toml_document import Document

__all__ = [
    "AXIAL_MM_PER_PX",
    "LATERAL_MM_PER_PX",
    "SLICE_MM",
    "AnatomyPx",
    "TrocarPx",
    "check_format",
    "lens_table",
    "registration_text",
    "scan_registration_text",
]

FORMAT = 1
"""Version of the file format."""
BASE64_COLUMNS = 100
AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, SLICE_MM = (0.0005, 0.02), (0.0005, 0.06), (0.0005, 0.5)
"""Plausible pixel size of B-scans, and their spacing in volumes, from existing scanners."""


class TrocarPx(Struct, frozen=True):
    """One trocar."""

    name: str
    point_px: Vec
    used: bool


class AnatomyPx(Struct, frozen=True):
    """The static anatomy in pixels of the image as stored."""

    width_px: int
    height_px: int
    mirrored: bool
    center_px: Vec
    radius_px: float
    """In the frontal image, if there is a homography or a lens."""
    diameter_mm: float
    contour_px: tuple[Vec, ...]
    target_px: Vec
    trocars: tuple[TrocarPx, ...]
    frontal_from_image: Homography | None = None
    """To the frontal image, where the camera is tilted; with a lens, from the image without distortion."""
    background_webp: bytes = b""
    """Reference image without instrument; transparent where the instrument always occludes the eye."""
    turn: Turn = UPRIGHT
    """How the source's images were turned."""
    assumed: tuple[str, ...] = ()
    """What was neither measured nor stated, by name (`registration.assumed`)."""
    depth: DepthPlane | None = None
    """Where the section is in depth images; None: not known."""
    lens: Lens | None = None
    """The calibrated lens; None: the image is taken as free of distortion."""

    @property
    def frontal_map(self) -> ImageMap | None:
        """To the frontal image without distortion; None if the image is that."""
        return image_map(self.lens, self.frontal_from_image)


def check_format(document: Document, version: int) -> None:
    """Refuse a registration file of another format version."""
    if version != FORMAT:
        raise document.error(f"unknown format {version}; this version reads format {FORMAT}", "format")


def registration_text(anatomy: AnatomyPx, title: str) -> str:
    """Return the text of a registration file; `title` is its first line, a comment."""
    contour = ", ".join(_px(point) for point in anatomy.contour_px)
    trocars = "".join(
        f'\n[[trocar]]\nname = "{trocar.name}"\npoint_px = {_px(trocar.point_px)}\n'
        f"used = {str(trocar.used).lower()}\n"
        for trocar in anatomy.trocars
    )
    return f"""# {title}
format = {FORMAT}
{_assumed_line(anatomy.assumed)}
[image]
width = {anatomy.width_px}
height = {anatomy.height_px}
mirrored = {str(anatomy.mirrored).lower()}

[globe]
center_px = {_px(anatomy.center_px)}
radius_px = {anatomy.radius_px:.3f}
diameter_mm = {anatomy.diameter_mm}

[retina]
contour_px = [{contour}]

[target]
point_px = {_px(anatomy.target_px)}
{trocars}{_source_table(anatomy.turn)}{depth_table(anatomy.depth)}{lens_table(anatomy.lens)}{_homography_table(anatomy.frontal_from_image)}{_background_table(anatomy.background_webp)}"""


def scan_registration_text(
    size_px: tuple[int, int],
    axial_mm_per_px: float,
    lateral_mm_per_px: float,
    title: str,
    depth_share: float = 0.7,
    assumed: Sequence[str] = (),
    volume: tuple[int, float] | None = None,
) -> str:
    """Return the text of a registration of B-scans or volumes.

    Args:
        size_px: (width, height) of a B-scan.
        axial_mm_per_px: Vertical scale.
        lateral_mm_per_px: Horizontal scale.
        title: First line of the file, a comment.
        depth_share: Depth of the target between the ILM (0) and the RPE (1).
        assumed: What was neither measured nor stated, by name.
        volume: Of a volume, how many B-scans it has and how far apart they are [mm].
    """
    table = f"[volume]\nslices = {volume[0]}\nslice_mm = {volume[1]:.9g}\n\n" if volume else ""
    return f"""# {title}
format = {FORMAT}
{_assumed_line(assumed)}
[image]
width = {size_px[0]}
height = {size_px[1]}

[scale]
axial_mm_per_px = {axial_mm_per_px:.9g}
lateral_mm_per_px = {lateral_mm_per_px:.9g}

{table}[target]
depth_share = {depth_share:g}
"""


def _assumed_line(assumed: Sequence[str]) -> str:
    if not assumed:
        return ""
    names = ", ".join(f'"{name}"' for name in assumed)
    return f"assumed = [{names}]  # not measured; remove a name when you have stated its value\n"


def _source_table(turn: Turn) -> str:
    if turn == UPRIGHT:
        return ""
    mirror = str(turn.mirror).lower()
    return f"\n[source]  # as the images were turned\nrotate_deg = {turn.rotate_deg}\nmirror = {mirror}\n"


def lens_table(lens: Lens | None) -> str:
    """Return the table [lens] of a registration or of lens.toml; empty without a lens."""
    if lens is None:
        return ""
    sd = (
        ""
        if lens.sd_px is None
        else f"sd_px = {lens.sd_px:.3g}  # of a corrected point, at the worst place\n"
    )
    distortion = ", ".join(f"{value:.9g}" for value in map(float, lens.distortion))
    return f"""
[lens]
focal_px = {_px(lens.focal_px)}
principal_px = {_px(lens.principal_px)}
distortion = [{distortion}]  # k1, k2, p1, p2, k3
{sd}"""


def _homography_table(frontal_from_image: Homography | None) -> str:
    if frontal_from_image is None:
        return ""
    rows = ",\n  ".join(str([float(f"{value:.9g}") for value in row]) for row in frontal_from_image.rows)
    return f"\n[homography]\nstraight_from_image = [\n  {rows},\n]\n"


def _background_table(webp: bytes) -> str:
    if not webp:
        return ""
    lines = "\n".join(wrap(base64.b64encode(webp).decode(), BASE64_COLUMNS))
    return f'\n[empty]  # reference image without instrument; optional\nwebp = """\n{lines}\n"""\n'


def _px(point: Vec) -> str:
    return f"[{point[0]:.3f}, {point[1]:.3f}]"
