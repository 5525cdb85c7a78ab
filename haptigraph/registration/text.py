"""Write a registration file: where the static anatomy lies in the images, as TOML.

Pixels in, text out; the checks are made when it is read. Used by whoever knows an anatomy.
"""

import base64
from textwrap import wrap

from msgspec import Struct

from haptigraph.geometry import Homography, Vec

__all__ = [
    "AXIAL_MM_PER_PX",
    "FORMAT",
    "LATERAL_MM_PER_PX",
    "AnatomyPx",
    "TrocarPx",
    "registration_text",
    "scan_registration_text",
]

FORMAT = 1
"""Version of the file."""
BASE64_COLUMNS = 100
AXIAL_MM_PER_PX, LATERAL_MM_PER_PX = (0.0005, 0.02), (0.0005, 0.06)
"""Plausible size of a B-scan's pixel: that of the scanners there are."""


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
    """In the straightened image, if there is one."""
    diameter_mm: float
    contour_px: tuple[Vec, ...]
    target_px: Vec
    trocars: tuple[TrocarPx, ...]
    frontal_from_image: Homography | None = None
    """To the straightened image, where the camera looks at a slant."""
    background_webp: bytes = b""
    """Picture of the eye without needle; transparent where it was never seen so."""


def registration_text(anatomy: AnatomyPx, title: str) -> str:
    """Return the file's text; `title` is its first line."""
    contour = ", ".join(_px(point) for point in anatomy.contour_px)
    trocars = "".join(
        f'\n[[trocar]]\nname = "{trocar.name}"\npoint_px = {_px(trocar.point_px)}\n'
        f"used = {str(trocar.used).lower()}\n"
        for trocar in anatomy.trocars
    )
    return f"""# {title}
format = {FORMAT}

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
{trocars}{_slant(anatomy.frontal_from_image)}{_empty(anatomy.background_webp)}"""


def scan_registration_text(
    size_px: tuple[int, int],
    axial_mm_per_px: float,
    lateral_mm_per_px: float,
    title: str,
    depth_share: float = 0.7,
) -> str:
    """Return the text of a registration of B-scans.

    Args:
        size_px: (width, height).
        axial_mm_per_px: Scale down the image.
        lateral_mm_per_px: Scale across.
        title: First line of the file.
        depth_share: How deep the target lies, of the way from ILM to RPE.
    """
    return f"""# {title}
format = {FORMAT}

[image]
width = {size_px[0]}
height = {size_px[1]}

[scale]
axial_mm_per_px = {axial_mm_per_px:.9g}
lateral_mm_per_px = {lateral_mm_per_px:.9g}

[target]
depth_share = {depth_share:g}
"""


def _slant(frontal_from_image: Homography | None) -> str:
    if frontal_from_image is None:
        return ""
    rows = ",\n  ".join(str([float(f"{value:.9g}") for value in row]) for row in frontal_from_image.rows)
    return f"\n[homography]\nstraight_from_image = [\n  {rows},\n]\n"


def _empty(webp: bytes) -> str:
    if not webp:
        return ""
    lines = "\n".join(wrap(base64.b64encode(webp).decode(), BASE64_COLUMNS))
    return f'\n[empty]  # the eye without needle; may be left out\nwebp = """\n{lines}\n"""\n'


def _px(at_px: Vec) -> str:
    return f"[{at_px[0]:.3f}, {at_px[1]:.3f}]"
