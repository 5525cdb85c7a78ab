"""Drafts of registrations: found, placed by default where `register` refuses, or read; corrected by hand.

Turns images into a draft, in pixels of the image as stored, and a draft into the file's text and picture. The
reader of registrations alone decides whether a draft is valid.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import asdict, replace

from haptigraph.analysis.registering.overrides import (
    ADULT_GLOBE_MM,
    NO_TROCAR,
    NOT_UPRIGHT,
    Overrides,
    apply_overrides,
    named_trocars,
    unclear_trocar,
)
from haptigraph.analysis.registering.picture import registration_picture
from haptigraph.analysis.registering.registering import plausible_anatomy
from haptigraph.analysis.registering.report import in_px_and_mm
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.lens import Lens
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.background_image import find_background_image
from haptigraph.perception.anatomy.moving_shaft import median_image
from haptigraph.perception.anatomy.rim import TYPICAL_WALL_MIDDLE
from haptigraph.perception.anatomy.upright import enters_above
from haptigraph.projection import Homography
from haptigraph.registration.assumed import POSITIONS, TROCAR, in_order
from haptigraph.registration.camera import Registration, anatomy_px
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.registration.text import AnatomyPx, TrocarPx, registration_text

__all__ = [
    "Draft",
    "DraftTrocar",
    "OpenedSource",
    "anatomy_px_of",
    "checked_registration",
    "draft_from",
    "draft_picture",
    "open_images",
]

DEFAULT_RADIUS = 0.36  # of the image's shorter side
DEFAULT_TROCAR_DEG = 36.0  # from the top
DEFAULT_RETINA_DEG = 60.0  # either way from the bottom
DEFAULT_POINTS = 25

Px = Annotated[float, Meta(ge=-1e5, le=1e5)]
PointPx = tuple[Px, Px]
# A single line without characters that end or escape a TOML string.
Name = Annotated[str, Meta(pattern=r'^[^"\\\x00-\x1f\x7f]{1,40}\Z')]
NameOrNone = Annotated[str, Meta(pattern=r'^[^"\\\x00-\x1f\x7f]{0,40}\Z')]
Positive = Annotated[float, Meta(gt=0, le=1e5)]


class DraftTrocar(Struct, frozen=True, forbid_unknown_fields=True):
    """One trocar."""

    name: Name
    point_px: PointPx
    used: bool


class Draft(Struct, frozen=True, forbid_unknown_fields=True):
    """What a person may correct, in pixels of the image as stored."""

    mirrored: bool
    diameter_mm: Positive
    center_px: PointPx
    radius_px: Positive
    """In the frontal image, where the camera is tilted."""
    contour_px: Annotated[tuple[PointPx, ...], Meta(min_length=2, max_length=1000)]
    target_px: PointPx
    trocars: Annotated[tuple[DraftTrocar, ...], Meta(min_length=1, max_length=8)]
    frontal_from_image: Homography | None = None
    """To the frontal image, where the camera is tilted; not editable."""
    assumed: Annotated[tuple[Name, ...], Meta(max_length=10)] = ()
    """What is neither measured nor stated, by name; an edit of it removes the name."""
    lens: Lens | None = None
    """The calibrated lens; not editable."""
    file: NameOrNone = ""
    """Name of the file it was read from, if any."""


class OpenedSource(Struct, frozen=True, eq=False):
    """A source in whose images the anatomy was searched."""

    source: str
    reference_image: Image
    """Median of its images."""
    anatomy: Anatomy | None
    """What `register` finds; None if it refuses."""
    draft: Draft
    """The initial draft."""
    note: str
    """What `register` did not find or leaves open, in one sentence; empty if nothing."""
    background_webp: bytes = b""
    """Reference image without instrument, if a needle moved."""
    turn: Turn = UPRIGHT
    """How its images were turned."""


def open_images(
    images: Sequence[Image], source: str, *, mirrored: bool, diameter_mm: float, turn: Turn = UPRIGHT
) -> OpenedSource:
    """Find the anatomy in images, or place a default draft where `register` refuses.

    Args:
        images: At least one, all of one size.
        source: Where they come from.
        mirrored: Whether the camera looks through a mirror.
        diameter_mm: Inner diameter of the globe.
        turn: How the images were turned.
    """
    overrides = Overrides(
        mirrored=None if mirrored else False,
        diameter_mm=None if diameter_mm == ADULT_GLOBE_MM else diameter_mm,
        turn=turn,
    )
    try:
        anatomy = plausible_anatomy(images, diameter_mm, source)
    except BadInput as error:
        reference_image = median_image(images)
        draft = _default_draft(reference_image.shape[1], reference_image.shape[0], overrides)
        return OpenedSource(source, reference_image, None, draft, error.problem, turn=turn)
    draft, note = _found_draft(anatomy, overrides, source)
    note = NOT_UPRIGHT if enters_above(images, anatomy) is False else note
    opened = OpenedSource(source, anatomy.reference_image, anatomy, draft, note, turn=turn)
    try:
        registration = checked_registration(opened, draft)
        background = find_background_image(images, anatomy.reference_image, registration)
    except BadInput:  # the draft needs correction first
        return opened
    return replace(opened, background_webp=background.webp) if background else opened


def anatomy_px_of(opened: OpenedSource, draft: Draft) -> AnatomyPx:
    """Return a draft as `registration_text` takes it.

    Raises:
        BadInput: If a point is far outside the image, where the homography may not be invertible.
    """
    height_px, width_px = opened.reference_image.shape[:2]
    points = draft.center_px, draft.target_px, *draft.contour_px, *(t.point_px for t in draft.trocars)
    for x, y in points:
        if not (-width_px <= x <= 2 * width_px and -height_px <= y <= 2 * height_px):
            raise BadInput(f"({x:g}, {y:g}) px lies far outside the {width_px} x {height_px} px image")
    trocars = tuple(TrocarPx(trocar.name, trocar.point_px, trocar.used) for trocar in draft.trocars)
    same = {name: each for name, each in asdict(draft).items() if name != "file"}
    more = {"trocars": trocars, "background_webp": opened.background_webp, "turn": opened.turn}
    return AnatomyPx(width_px=width_px, height_px=height_px, **{**same, **more})


def draft_from(registration: Registration, file: str, opened: OpenedSource) -> Draft:
    """Return the draft of a registration that was read from a file.

    Raises:
        BadInput: If it is for other images, or a value is outside a draft's limits.
    """
    data, (height_px, width_px) = anatomy_px(registration), opened.reference_image.shape[:2]
    if (data.width_px, data.height_px) != (width_px, height_px):
        is_for = f"is for images of {data.width_px} x {data.height_px} px"
        raise BadInput(f"{is_for}, but this one is {width_px} x {height_px} px")
    registration.check_turn(opened.turn, file)
    trocars = tuple(DraftTrocar(each.name, each.point_px, each.used) for each in data.trocars)
    try:
        draft = replace(_draft(data, trocars), file=_line(file.replace('"', "'"))[:40])
        return msgspec.convert(msgspec.to_builtins(draft), Draft)
    except msgspec.ValidationError as error:
        raise BadInput(f"cannot be corrected here: {error}") from None


def checked_registration(opened: OpenedSource, draft: Draft) -> Registration:
    """Write a draft as a registration, and read it back with all checks.

    Raises:
        BadInput: If a run would refuse it.
    """
    text = registration_text(anatomy_px_of(opened, draft), _title(opened, draft))
    return parse_camera_registration(text, "registration")


def draft_picture(opened: OpenedSource, draft: Draft) -> bytes:
    """Draw a draft over the image, as `register` does, and return the PNG.

    Raises:
        BadInput: If a run would refuse it.
    """
    registration = checked_registration(opened, draft)
    return registration_picture(
        opened.reference_image,
        registration,
        anatomy_px_of(opened, draft),
        _how(opened, draft),
        opened.anatomy,
    )


def _title(opened: OpenedSource, draft: Draft) -> str:
    return f"Registration {_how(opened, draft, f' in {_line(Path(opened.source).name)}')}."


def _line(text: str) -> str:
    """Join the lines of a text, because a line break would end a comment."""
    return " ".join(text.split())


def _how(opened: OpenedSource, draft: Draft, where: str = "") -> str:
    """Describe the origin and uncertainty of a draft."""
    if draft.file:
        return f"of {draft.file}, corrected by hand{where}"
    if opened.anatomy is None:
        return f"placed by hand{where}"
    by_hand = "" if draft == opened.draft else ", corrected by hand"
    uncertainty = in_px_and_mm(opened.anatomy.rim_uncertainty_px, draft.diameter_mm / (2 * draft.radius_px))
    return f"found by haptigraph{where}{by_hand}; globe and retina were uncertain by {uncertainty}"


def _found_draft(anatomy: Anatomy, overrides: Overrides, source: str) -> tuple[Draft, str]:
    """Return the anatomy found as a draft, and a note of what it leaves open."""
    named = named_trocars(anatomy, overrides.is_mirrored)
    side = "right" if overrides.is_mirrored else "left"  # of the surgeon, for the image's left
    note = ""
    if not named:
        x, y = anatomy.image_px(
            _point_at(anatomy.center_px, TYPICAL_WALL_MIDDLE * anatomy.radius_px, DEFAULT_TROCAR_DEG - 180)
        )
        trocar_option = f"{x},{y}"  # on the image's left
        note = f"{NO_TROCAR}; drag the trocar to the needle's remote centre of motion"
    else:
        trocar_option = named[0][0]
        unclear = unclear_trocar(named)
        note = f"{unclear}; choose it" if unclear else ""
    mm_per_px = overrides.globe_mm / (2 * anatomy.radius_px)
    data = apply_overrides(anatomy, replace(overrides, trocar=trocar_option), mm_per_px, source)
    trocars = tuple(
        DraftTrocar(trocar.name if named else side, trocar.point_px, trocar.used) for trocar in data.trocars
    )
    draft = _draft(data, trocars)
    return (replace(draft, assumed=in_order((*draft.assumed, TROCAR))) if note else draft), note


def _draft(data: AnatomyPx, trocars: tuple[DraftTrocar, ...]) -> Draft:
    return Draft(
        mirrored=data.mirrored,
        diameter_mm=data.diameter_mm,
        center_px=data.center_px,
        radius_px=data.radius_px,
        contour_px=data.contour_px,
        target_px=data.target_px,
        trocars=trocars,
        frontal_from_image=data.frontal_from_image,
        assumed=data.assumed,
        lens=data.lens,
    )


def _default_draft(width_px: int, height_px: int, overrides: Overrides) -> Draft:
    """Return an eye in the middle of the image, for a person to correct."""
    center = (width_px - 1) / 2, (height_px - 1) / 2
    radius = DEFAULT_RADIUS * min(width_px, height_px)
    steps = [2 * number / (DEFAULT_POINTS - 1) - 1 for number in range(DEFAULT_POINTS)]
    trocar = _point_at(center, TYPICAL_WALL_MIDDLE * radius, DEFAULT_TROCAR_DEG - 180)
    return Draft(
        mirrored=overrides.is_mirrored,
        diameter_mm=overrides.globe_mm,
        center_px=center,
        radius_px=radius,
        contour_px=tuple(_point_at(center, radius, step * DEFAULT_RETINA_DEG) for step in steps),
        target_px=_point_at(center, radius, 0.0),
        trocars=(DraftTrocar("right" if overrides.is_mirrored else "left", trocar, used=True),),
        assumed=in_order((*POSITIONS, *overrides.assumed)),
    )


def _point_at(center_px: Vec, radius_px: float, angle_deg: float) -> Vec:
    """Return the point on a circle at an angle from the bottom, positive to the image's right."""
    angle = math.radians(angle_deg)
    return center_px[0] + radius_px * math.sin(angle), center_px[1] + radius_px * math.cos(angle)
