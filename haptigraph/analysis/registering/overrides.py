"""Join what was found with what the user says about the set-up: target, trocar in use, scale, mirror.

Anatomy and wishes in, the registration's data out. Knows no files.
"""

import math
from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry, Polyline, Vec, nearest_on_polyline
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar
from haptigraph.registration.camera import DIAMETER_RANGE_MM
from haptigraph.registration.retarget import along_retina, angle_rad
from haptigraph.registration.text import AnatomyPx, TrocarPx

__all__ = ["Overrides", "check_overrides", "named_trocars", "settled", "unclear_trocar"]

SNAP_MM = 1.5  # so far off the retina a target given in pixels may lie


class Overrides(Struct, frozen=True):
    """What the user says about the set-up."""

    target: str | None = None
    target_mm: float | None = None
    trocar: str | None = None
    mirrored: bool = True
    diameter_mm: float = 24.0
    images: int = 40


def check_overrides(overrides: Overrides) -> None:
    """Refuse wishes that make no sense whatever the image shows."""
    if overrides.target is not None and overrides.target_mm is not None:
        raise BadInput("--target and --target-mm say the same thing twice; give one")
    if overrides.images < 1:
        raise BadInput(f"--images {overrides.images}; at least 1 is needed")
    low, high = DIAMETER_RANGE_MM
    if not low <= overrides.diameter_mm <= high:
        raise BadInput(
            f"--diameter-mm {overrides.diameter_mm:g} is not an eye; {low:g} to {high:g} is plausible"
        )
    for option, text in (("--target", overrides.target), ("--trocar", overrides.trocar)):
        if text is not None and not (option == "--trocar" and text in ("left", "right")):
            _place(option, text)


def settled(anatomy: Anatomy, overrides: Overrides, mm_per_px: float, source: str) -> AnatomyPx:
    """Return the registration's data.

    Raises:
        BadInput: If a wish does not fit what was found.
    """
    way = anatomy.tilt.frontal_from_image if anatomy.tilt else None
    frontal = ImageGeometry(anatomy.center_px, mm_per_px, overrides.mirrored)
    image = replace(frontal, frontal_from_image=way)
    retina = Polyline(tuple(frontal.to_mm(point) for point in anatomy.contour_px))
    trocars = _with_used(named_trocars(anatomy, overrides.mirrored), anatomy, overrides.trocar, source)
    return AnatomyPx(
        width_px=anatomy.still.shape[1],
        height_px=anatomy.still.shape[0],
        mirrored=overrides.mirrored,
        center_px=anatomy.seen_px(anatomy.center_px),
        radius_px=anatomy.radius_px,
        diameter_mm=overrides.diameter_mm,
        contour_px=tuple(
            anatomy.seen_px(point) for point in anatomy.contour_px[:: -1 if overrides.mirrored else 1]
        ),
        target_px=image.to_px(_target_mm(retina, image, overrides, source)),
        trocars=tuple(replace(trocar, point_px=anatomy.seen_px(trocar.point_px)) for trocar in trocars),
        frontal_from_image=way,
    )


def named_trocars(anatomy: Anatomy, mirrored: bool) -> list[tuple[str, FoundTrocar]]:
    """Name trocars by the surgeon's side; a second one on the same side has a number."""
    named: list[tuple[str, FoundTrocar]] = []
    for trocar in anatomy.trocars:
        side = "right" if (trocar.angle_deg > 0) != mirrored else "left"
        same = sum(name.startswith(side) for name, _ in named)
        named.append((f"{side} {same + 1}" if same else side, trocar))
    return named


def unclear_trocar(named: Sequence[tuple[str, FoundTrocar]]) -> str:
    """Say why it is open which of some trocars the needle goes through; empty: it does not."""
    moving = [name for name, trocar in named if trocar.rcm is not None]
    if len(moving) > 1:
        return f"something moves in more than one trocar ({', '.join(moving)}) and may be the needle"
    return "" if moving or len(named) < 2 else "no needle moves to show which trocar is in use"


def _with_used(
    named: Sequence[tuple[str, FoundTrocar]], anatomy: Anatomy, wish: str | None, source: str
) -> tuple[TrocarPx, ...]:
    """Settle which trocar is in use: the user's word, the moving needle, or the only hole."""
    seen = [(name, anatomy.seen_px(t.point_px)) for name, t in named]
    told = ", ".join(f"{name} at ({x:.0f}, {y:.0f}) px" for name, (x, y) in seen)
    if wish and "," in wish:
        place = anatomy.frontal_px(_place("--trocar", wish))
        others = [(name, t) for name, t in named if math.dist(t.point_px, place) > 0.15 * anatomy.radius_px]
        return TrocarPx("given", place, used=True), *(TrocarPx(n, t.point_px, used=False) for n, t in others)
    if wish:
        if wish not in dict(named):
            raise BadInput(
                f"no trocar found on the {wish}; found: {told or 'none'}; give --trocar X,Y", source
            )
        used = wish
    elif not named:
        raise BadInput(
            "no trocar found: no needle moves, and no hole is seen inside the wall; "
            "give a clip with a moving needle, or --trocar X,Y",
            source,
        )
    elif unclear := unclear_trocar(named):
        raise BadInput(f"{unclear}; give --trocar: {told}", source)
    else:
        used = named[0][0]
    return tuple(TrocarPx(name, trocar.point_px, name == used) for name, trocar in named)


def _target_mm(retina: Polyline, image: ImageGeometry, overrides: Overrides, source: str) -> Vec:
    """Return the target on the retina: the place nearest to the given one, or so far along it."""
    if overrides.target is not None:
        place = image.to_mm(_place("--target", overrides.target))
        nearest = nearest_on_polyline(place, retina)
        off_mm = math.dist(nearest, place)
        if off_mm > SNAP_MM:
            raise BadInput(
                f"--target {overrides.target} lies {off_mm:.1f} mm off the retina; "
                f"at most {SNAP_MM} mm is moved onto it",
                source,
            )
        return nearest
    wanted_mm = overrides.target_mm or 0.0
    place_mm = along_retina(retina, overrides.diameter_mm / 2, wanted_mm)
    if place_mm is None:
        reach_mm = max(angle_rad(place_mm) for place_mm in retina.points_mm) * overrides.diameter_mm / 2
        raise BadInput(
            f"--target-mm {wanted_mm:g} is beyond the retina, which reaches {reach_mm:.1f} mm either way"
        )
    return place_mm


def _place(option: str, text: str) -> Vec:
    """Read "x,y"."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        names = "left, right or " if option == "--trocar" else ""
        raise BadInput(f"{option} {text!r} is no place; {names}X,Y in pixels is valid, e.g. 602.5,641")
    return x, y
