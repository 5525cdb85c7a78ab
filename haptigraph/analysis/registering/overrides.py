"""Combine the anatomy found with the user's overrides: target, trocar in use, scale, mirror."""

import math
from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, Vec, nearest_on_polyline
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar
from haptigraph.projection import ImageGeometry
from haptigraph.registration.assumed import LENS, MIRROR, RIM, SCALE, TARGET, in_order
from haptigraph.registration.camera import DIAMETER_RANGE_MM
from haptigraph.registration.retarget import point_on_retina, retina_angle_rad
from haptigraph.registration.text import AnatomyPx, TrocarPx

__all__ = [
    "MAX_LENS_RISK_PX",
    "NOT_UPRIGHT",
    "UPRIGHT_HINT",
    "Overrides",
    "apply_overrides",
    "check_overrides",
    "named_trocars",
    "unclear_trocar",
]

ADULT_GLOBE_MM = 24.0
MAX_LENS_RISK_PX = 3.0
SNAP_MM = 1.5
"""Maximum distance from the retina of a target given in pixels."""
UPRIGHT_HINT = (
    "the eye must be upright, trocars on top, or be turned with --set source.rotate_deg=90, 180 or 270"
)
NOT_UPRIGHT = f"the needle does not enter the eye from above; {UPRIGHT_HINT}"
NO_TROCAR = "no trocar found: no needle moves, and no port opening is visible inside the wall"


class Overrides(Struct, frozen=True):
    """The user's settings of the set-up; they take precedence over what is found. None: not stated."""

    target: str | None = None
    target_mm: float | None = None
    trocar: str | None = None
    mirrored: bool | None = None
    diameter_mm: float | None = None
    images: int = 40
    turn: Turn = UPRIGHT
    """How the source's images are turned."""
    lens: str | None = None
    """Path of lens.toml, for images before they are turned."""

    @property
    def is_mirrored(self) -> bool:
        """Whether the images are mirrored, as stated; or else assumed, unless they are turned back."""
        return not self.turn.mirror if self.mirrored is None else self.mirrored

    @property
    def globe_mm(self) -> float:
        """Inner diameter of the globe, as stated or else assumed."""
        return ADULT_GLOBE_MM if self.diameter_mm is None else self.diameter_mm

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the settings that nobody stated."""
        is_stated = {
            TARGET: self.target is not None or self.target_mm is not None,
            SCALE: self.diameter_mm is not None,
            MIRROR: self.mirrored is not None,
        }
        return tuple(name for name, stated in is_stated.items() if not stated)


def check_overrides(overrides: Overrides) -> None:
    """Refuse overrides that are invalid for any image."""
    if overrides.target is not None and overrides.target_mm is not None:
        raise BadInput("--target and --target-mm exclude each other; give one")
    if overrides.images < 1:
        raise BadInput(f"--images {overrides.images} is too few; use at least 1")
    low, high = DIAMETER_RANGE_MM
    if not low <= overrides.globe_mm <= high:
        raise BadInput(
            f"--diameter-mm {overrides.globe_mm:g} is implausible for an eye; use {low:g} to {high:g}"
        )
    for option, text in (("--target", overrides.target), ("--trocar", overrides.trocar)):
        if text is not None and not (option == "--trocar" and text in ("left", "right")):
            _parse_point(option, text)


def apply_overrides(anatomy: Anatomy, overrides: Overrides, mm_per_px: float, source: str) -> AnatomyPx:
    """Return the registration's data.

    Raises:
        BadInput: If an override does not fit what was found.
    """
    frontal = ImageGeometry(anatomy.center_px, mm_per_px, overrides.is_mirrored)
    image = replace(frontal, frontal_from_image=anatomy.frontal_map)
    retina = Polyline(tuple(frontal.to_mm(point) for point in anatomy.contour_px))
    trocars = _with_used(named_trocars(anatomy, overrides.is_mirrored), anatomy, overrides.trocar, source)
    return AnatomyPx(
        width_px=anatomy.reference_image.shape[1],
        height_px=anatomy.reference_image.shape[0],
        mirrored=overrides.is_mirrored,
        center_px=anatomy.image_px(anatomy.center_px),
        radius_px=anatomy.radius_px,
        diameter_mm=overrides.globe_mm,
        contour_px=tuple(
            anatomy.image_px(point) for point in anatomy.contour_px[:: -1 if overrides.is_mirrored else 1]
        ),
        target_px=image.to_px(_target_point_mm(retina, image, overrides, source)),
        trocars=tuple(replace(trocar, point_px=anatomy.image_px(trocar.point_px)) for trocar in trocars),
        frontal_from_image=anatomy.tilt.frontal_from_image if anatomy.tilt else None,
        lens=anatomy.lens,
        turn=overrides.turn,
        assumed=in_order((*overrides.assumed, *_assumed_of_camera(anatomy))),
    )


def _assumed_of_camera(anatomy: Anatomy) -> tuple[str, ...]:
    rim = () if anatomy.rim_evidence else (RIM,)
    return (*rim, LENS) if (anatomy.lens_risk_px or 0.0) > MAX_LENS_RISK_PX else rim


def named_trocars(anatomy: Anatomy, mirrored: bool) -> list[tuple[str, FoundTrocar]]:
    """Name trocars by the surgeon's side; number further ones on the same side."""
    named: list[tuple[str, FoundTrocar]] = []
    for trocar in anatomy.trocars:
        side = "right" if (trocar.angle_deg > 0) != mirrored else "left"
        same = sum(name.startswith(side) for name, _ in named)
        named.append((f"{side} {same + 1}" if same else side, trocar))
    return named


def unclear_trocar(named: Sequence[tuple[str, FoundTrocar]]) -> str:
    """Say why the trocar in use is ambiguous; empty if it is not."""
    moving = [name for name, trocar in named if trocar.rcm is not None]
    if len(moving) > 1:
        return f"something moves in more than one trocar ({', '.join(moving)}) and may be the needle"
    return "" if moving or len(named) < 2 else "no needle moves to show which trocar is in use"


def _with_used(
    named: Sequence[tuple[str, FoundTrocar]], anatomy: Anatomy, requested: str | None, source: str
) -> tuple[TrocarPx, ...]:
    """Determine the trocar in use: by the override, the moving needle, or because there is only one."""
    points_px = [(name, anatomy.image_px(t.point_px)) for name, t in named]
    candidates = ", ".join(f"{name} at ({x:.0f}, {y:.0f}) px" for name, (x, y) in points_px)
    if requested and "," in requested:
        point = anatomy.frontal_px(_parse_point("--trocar", requested))
        others = [(name, t) for name, t in named if math.dist(t.point_px, point) > 0.15 * anatomy.radius_px]
        return TrocarPx("given", point, used=True), *(TrocarPx(n, t.point_px, used=False) for n, t in others)
    if requested:
        if requested not in dict(named):
            raise BadInput(
                f"no trocar found on the {requested}; found: {candidates or 'none'}; give --trocar X,Y",
                source,
            )
        used = requested
    elif not named:
        raise BadInput(
            f"{NO_TROCAR}; give a clip with a moving needle, or --trocar X,Y; {UPRIGHT_HINT}", source
        )
    elif unclear := unclear_trocar(named):
        raise BadInput(f"{unclear}; give --trocar: {candidates}", source)
    else:
        used = named[0][0]
    return tuple(TrocarPx(name, trocar.point_px, name == used) for name, trocar in named)


def _target_point_mm(retina: Polyline, image: ImageGeometry, overrides: Overrides, source: str) -> Vec:
    """Return the target on the retina: the point nearest to the given one, or at the given arc length."""
    if overrides.target is not None:
        point = image.to_mm(_parse_point("--target", overrides.target))
        nearest = nearest_on_polyline(point, retina)
        off_mm = math.dist(nearest, point)
        if off_mm > SNAP_MM:
            raise BadInput(
                f"--target {overrides.target} is {off_mm:.1f} mm off the retina; at most {SNAP_MM} mm is "
                f"corrected; {UPRIGHT_HINT}",
                source,
            )
        return nearest
    along_mm = overrides.target_mm or 0.0
    point_mm = point_on_retina(retina, overrides.globe_mm / 2, along_mm)
    if point_mm is None:
        reach_mm = max(retina_angle_rad(point_mm) for point_mm in retina.points_mm) * overrides.globe_mm / 2
        raise BadInput(
            f"--target-mm {along_mm:g} is beyond the retina, which extends {reach_mm:.1f} mm either way"
        )
    return point_mm


def _parse_point(option: str, text: str) -> Vec:
    """Parse "x,y"."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        names = "left, right or " if option == "--trocar" else ""
        raise BadInput(f"{option} {text!r} is not a point; use {names}X,Y in pixels, e.g. 602.5,641")
    return x, y
