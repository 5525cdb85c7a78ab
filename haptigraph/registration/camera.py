"""Registration of an eye before a camera: check the static anatomy in a TOML file, map it to the eye frame.

docs/reference/conventions.md describes the format.
"""

import base64
import math
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from haptigraph.geometry import (
    Circle,
    Geometry,
    Point,
    Polyline,
    Vec,
    distance_to_polyline,
    norm,
    subtract,
)
from haptigraph.imaging import Rotation, Turn
from haptigraph.lens import Lens
from haptigraph.projection import Homography, ImageGeometry, ImageMap, image_map
from haptigraph.registration.assumed import check_assumed
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.depth import DepthPlane, check_depth
from haptigraph.registration.lens_file import check_lens
from haptigraph.registration.registered import VIEW_MARGIN, BaseRegistration
from haptigraph.registration.text import AnatomyPx, TrocarPx, check_format
from haptigraph.toml_document import Document

__all__ = ["DIAMETER_RANGE_MM", "MIN_RADIUS_PX", "Registration", "anatomy_px", "camera_registration"]

DIAMETER_RANGE_MM = (15.0, 35.0)  # eyes of children, adults, pigs and their phantoms
MIN_RADIUS_PX = 60.0
"""Of a globe; in a smaller one the 0.7 mm zones are less than 4 px wide."""
TARGET_TOLERANCE_MM = 0.35  # half the touching distance
CONTOUR_TOLERANCE_MM = 0.5
WALL_RANGE_MM = (-0.7, 3.0)  # of a trocar, outwards from the inner surface of the globe's wall
MIN_AXIS_MM = 5.0
FRONTAL_SCALE = (0.5, 2.0)  # plausible scale of the homography at the globe's centre

Row: TypeAlias = tuple[float, float, float]


class _Image(Struct, frozen=True, forbid_unknown_fields=True):
    width: int
    height: int
    mirrored: bool


class _Globe(Struct, frozen=True, forbid_unknown_fields=True):
    center_px: Vec
    radius_px: float
    diameter_mm: float


class _Retina(Struct, frozen=True, forbid_unknown_fields=True):
    contour_px: tuple[Vec, ...]


class _Target(Struct, frozen=True, forbid_unknown_fields=True):
    point_px: Vec


class _Trocar(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    point_px: Vec
    used: bool


class _Homography(Struct, frozen=True, forbid_unknown_fields=True):
    frontal_from_image: tuple[Row, Row, Row] = field(name="straight_from_image")


class _Source(Struct, frozen=True, forbid_unknown_fields=True):
    rotate_deg: Rotation = 0
    mirror: bool = False


class _BackgroundTable(Struct, frozen=True, forbid_unknown_fields=True):
    webp: str


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    format: int
    image: _Image
    globe: _Globe
    retina: _Retina
    target: _Target
    trocars: tuple[_Trocar, ...] = field(name="trocar")
    homography: _Homography | None = None
    background: _BackgroundTable | None = field(name="empty", default=None)
    assumed: tuple[str, ...] = ()
    source: _Source = _Source()
    depth: DepthPlane | None = None
    lens: Lens | None = None


class Registration(BaseRegistration, frozen=True):
    """The static anatomy of one camera set-up."""

    globe: Circle
    retina: Polyline
    target: Point
    trocar: Point
    """The trocar in use: the needle's remote centre of motion (RCM)."""
    other_trocars: tuple[Point, ...]
    """Those that another instrument may go through."""
    background: BackgroundImage | None = None
    """Reference image without instrument, if the file has one."""

    @property
    def anatomy(self) -> dict[str, Geometry]:
        """The static entities by name, eye frame."""
        return {
            "eye_globe": self.globe,
            "retina_surface": self.retina,
            "retina_target": self.target,
            "trocar": self.trocar,
        }

    @property
    def view_half_mm(self) -> float:
        """Half the side of a square view of the globe."""
        return self.globe.radius_mm * VIEW_MARGIN

    @property
    def frontal(self) -> "Registration":
        """The same registration for tilt-corrected (frontal) images without distortion."""
        frontal = self.image.frontal_from_image
        background = (
            self.background.tilt_corrected(frontal) if self.background and frontal else self.background
        )
        return replace(self, image=replace(self.image, frontal_from_image=None), background=background)


def anatomy_px(registration: Registration) -> AnatomyPx:
    """Return the content of a registration's file: the anatomy in pixels, with all trocars."""
    data = Document(registration.text, "registration").convert(_File)
    return AnatomyPx(
        width_px=data.image.width,
        height_px=data.image.height,
        mirrored=data.image.mirrored,
        center_px=data.globe.center_px,
        radius_px=data.globe.radius_px,
        diameter_mm=data.globe.diameter_mm,
        contour_px=data.retina.contour_px,
        target_px=data.target.point_px,
        trocars=tuple(TrocarPx(each.name, each.point_px, each.used) for each in data.trocars),
        frontal_from_image=_homography(data),
        background_webp=_webp(data),
        assumed=registration.assumed,
        turn=registration.turn,
        depth=registration.depth,
        lens=data.lens,
    )


def camera_registration(document: Document) -> Registration:
    """Check the registration of an eye before a camera.

    Raises:
        BadInput: With file, line and reason, if it is not valid.
    """
    data = document.convert(_File)
    check_format(document, data.format)
    _check_image_and_globe(document, data)
    frontal = _frontal_from_image(document, data)
    geometry = ImageGeometry(
        center_px=frontal(data.globe.center_px) if frontal else data.globe.center_px,
        mm_per_px=data.globe.diameter_mm / (2 * data.globe.radius_px),
        mirrored=data.image.mirrored,
        frontal_from_image=frontal,
    )
    globe = Circle((0.0, 0.0), data.globe.diameter_mm / 2)
    retina = Polyline(tuple(geometry.to_mm(point) for point in data.retina.contour_px))
    target = geometry.to_mm(data.target.point_px)
    _check_retina(document, retina, globe)
    off_mm = distance_to_polyline(target, retina)
    if off_mm > TARGET_TOLERANCE_MM:
        raise document.error(
            f"the target is {off_mm:.2f} mm off the retina; at most {TARGET_TOLERANCE_MM} mm is plausible",
            "target.point_px",
        )
    return Registration(
        width_px=data.image.width,
        height_px=data.image.height,
        image=geometry,
        globe=globe,
        retina=retina,
        target=Point(target),
        trocar=Point(_used_trocar(document, data, geometry, globe, target)),
        other_trocars=tuple(
            Point(geometry.to_mm(trocar.point_px)) for trocar in data.trocars if not trocar.used
        ),
        text=document.text,
        background=_background_image(document, data),
        assumed=check_assumed(document, data.assumed),
        turn=Turn(data.source.rotate_deg, data.source.mirror),
        depth=check_depth(document, data.depth, geometry),
    )


def _check_image_and_globe(document: Document, data: _File) -> None:
    image, globe = data.image, data.globe
    if image.width < 1 or image.height < 1:
        raise document.error(f"image size {image.width} x {image.height} px is not positive", "image.width")
    low, high = DIAMETER_RANGE_MM
    if not low <= globe.diameter_mm <= high:
        raise document.error(
            f"a globe diameter of {globe.diameter_mm:g} mm is implausible; use {low:g} to {high:g} mm",
            "globe.diameter_mm",
        )
    largest_px = math.hypot(image.width, image.height) / 2
    if not MIN_RADIUS_PX <= globe.radius_px <= largest_px:
        raise document.error(
            f"a globe radius of {globe.radius_px:g} px gives an implausible scale; in an image of this size "
            f"{MIN_RADIUS_PX:g} to {largest_px:.0f} px is plausible",
            "globe.radius_px",
        )
    x, y = globe.center_px
    if not (0 <= x < image.width and 0 <= y < image.height):
        raise document.error(
            f"the globe's centre ({x:g}, {y:g}) px is outside the {image.width} x {image.height} px image",
            "globe.center_px",
        )


def _homography(data: _File) -> Homography | None:
    return Homography(data.homography.frontal_from_image) if data.homography else None


def _frontal_from_image(document: Document, data: _File) -> ImageMap | None:
    """Return the map to the frontal image, if there is one and a camera before the eye can have it."""
    size, homography = (data.image.width, data.image.height), _homography(data)
    if data.lens is not None:
        check_lens(document, data.lens, *size)
    frontal = image_map(data.lens, homography)
    if homography is None or frontal is None:
        return frontal
    path = "homography.straight_from_image"
    corners = [(float(x), float(y)) for x in (0, data.image.width) for y in (0, data.image.height)]
    ideal = np.array([(*(data.lens.undistorted(corner) if data.lens else corner), 1) for corner in corners])
    if not (ideal @ homography.matrix[2] > 0).all():
        raise document.error("the homography maps a part of the image to infinity", path)
    x, y = data.globe.center_px
    (px, py), (rx, ry), (dx, dy) = (frontal(point) for point in ((x, y), (x + 1, y), (x, y + 1)))
    area = (rx - px) * (dy - py) - (ry - py) * (dx - px)
    low, high = FRONTAL_SCALE
    if not low**2 <= area <= high**2:
        raise document.error(
            f"the homography scales areas by {area:.3g} at the globe's centre; "
            f"{low**2:g} to {high**2:g} is plausible",
            path,
        )
    return frontal


def _background_image(document: Document, data: _File) -> BackgroundImage | None:
    """Decode the reference image without instrument, if there is one, and check its size."""
    if data.background is None:
        return None
    try:
        background = BackgroundImage.of_webp(_webp(data))
    except ValueError:
        background = None
    if background is None:
        raise document.error("empty.webp: expected a colour image as WebP in base64", "empty.webp")
    (height, width), size = background.is_known.shape, data.image
    if (width, height) != (size.width, size.height):
        problem = f"empty.webp: is {width} x {height} px, but the images are {size.width} x {size.height} px"
        raise document.error(problem, "empty.webp")
    return background


def _webp(data: _File) -> bytes:
    return base64.b64decode("".join(data.background.webp.split()), validate=True) if data.background else b""


def _check_retina(document: Document, retina: Polyline, globe: Circle) -> None:
    path = "retina.contour_px"
    if len(retina.points_mm) < 3:
        raise document.error(f"the contour has {len(retina.points_mm)} points; at least 3 are needed", path)
    for number, point in enumerate(retina.points_mm):
        outside_mm = norm(point) - globe.radius_mm
        if outside_mm > CONTOUR_TOLERANCE_MM:
            raise document.error(
                f"contour point {number} lies {outside_mm:.2f} mm outside the globe; all must be inside", path
            )
    turns = [a[0] * b[1] - a[1] * b[0] for a, b in pairwise(retina.points_mm)]
    if not (all(turn > 0 for turn in turns) or all(turn < 0 for turn in turns)):
        wrong = next(number for number, turn in enumerate(turns, 1) if turn * turns[0] <= 0)
        raise document.error(
            f"contour point {wrong} goes back; points must follow the retina in one direction",
            path,
        )


def _used_trocar(document: Document, data: _File, geometry: ImageGeometry, globe: Circle, target: Vec) -> Vec:
    low, high = WALL_RANGE_MM
    for number, trocar in enumerate(data.trocars):
        outwards_mm = norm(geometry.to_mm(trocar.point_px)) - globe.radius_mm
        if not low <= outwards_mm <= high:
            side = "inside" if outwards_mm < 0 else "outside"
            raise document.error(
                f"trocar {trocar.name!r} is {abs(outwards_mm):.2f} mm {side} the globe's inner wall; "
                f"it must be in the wall, at most {-low:g} mm inside or {high:g} mm outside",
                f"trocar[{number}].point_px",
            )
    used = [trocar for trocar in data.trocars if trocar.used]
    if len(used) != 1:
        raise document.error(
            f"{len(used)} of {len(data.trocars)} trocars are marked as used; mark exactly one", "trocar"
        )
    point = geometry.to_mm(used[0].point_px)
    length_mm = norm(subtract(target, point))
    if length_mm < MIN_AXIS_MM:
        raise document.error(
            f"trocar {used[0].name!r} is {length_mm:.1f} mm from the target; "
            f"{MIN_AXIS_MM:g} mm or more is plausible",
            "target.point_px",
        )
    return point
