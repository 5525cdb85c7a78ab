"""A registration before it is saved: found, guessed where `register` refuses, or read; corrected by hand.

Images in; a draft, in pixels of the image as stored, and the file's text and picture out. Whether it is sound
is said by the reader of registrations, and by nobody else. Knows neither files nor pages.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import asdict, replace

from haptigraph.analysis.registering.overrides import Overrides, named_trocars, settled, unclear_trocar
from haptigraph.analysis.registering.picture import registration_picture
from haptigraph.analysis.registering.registering import sound_anatomy
from haptigraph.analysis.registering.report import in_px_and_mm
from haptigraph.errors import BadInput
from haptigraph.geometry import Homography, Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.background_image import find_background_image
from haptigraph.perception.anatomy.moving_shaft import still_picture
from haptigraph.registration.camera import Registration, anatomy_px, parse_registration
from haptigraph.registration.text import AnatomyPx, TrocarPx, registration_text

__all__ = [
    "Draft",
    "DraftTrocar",
    "Opened",
    "data_of",
    "draft_from",
    "open_images",
    "sound_picture",
    "sound_registration",
]

GUESSED_RADIUS = 0.36  # of the image's shorter side
GUESSED_TROCAR_DEG = 36.0  # from the top
GUESSED_RETINA_DEG = 60.0  # either way from the bottom
GUESSED_POINTS = 25
WALL_MIDDLE = 1.07  # of the globe's radius

Px = Annotated[float, Meta(ge=-1e5, le=1e5)]
Place = tuple[Px, Px]
# One line that may stand in TOML's quotes.
Name = Annotated[str, Meta(pattern=r'^[^"\\\x00-\x1f\x7f]{1,40}\Z')]
NameOrNone = Annotated[str, Meta(pattern=r'^[^"\\\x00-\x1f\x7f]{0,40}\Z')]
Positive = Annotated[float, Meta(gt=0, le=1e5)]


class DraftTrocar(Struct, frozen=True, forbid_unknown_fields=True):
    """One trocar."""

    name: Name
    point_px: Place
    used: bool


class Draft(Struct, frozen=True, forbid_unknown_fields=True):
    """What a person may change; pixels of the image as stored."""

    mirrored: bool
    diameter_mm: Positive
    center_px: Place
    radius_px: Positive
    """In the straightened image, where there is a slant."""
    contour_px: Annotated[tuple[Place, ...], Meta(min_length=2, max_length=1000)]
    target_px: Place
    trocars: Annotated[tuple[DraftTrocar, ...], Meta(min_length=1, max_length=8)]
    frontal_from_image: Homography | None = None
    """Where the camera looks at a slant; nobody drags it."""
    file: NameOrNone = ""
    """Name of the file it was read from, if any."""


class Opened(Struct, frozen=True, eq=False):
    """A source that was looked at."""

    source: str
    still: Image
    """Its images without what moves."""
    anatomy: Anatomy | None
    """What `register` found; None if it refuses."""
    draft: Draft
    """To begin with."""
    note: str
    """What `register` could not find or tell, in a sentence; empty: nothing."""
    background_webp: bytes = b""
    """Picture of the eye without needle, if one was seen to move."""


def open_images(images: Sequence[Image], source: str, *, mirrored: bool, diameter_mm: float) -> Opened:
    """Find the anatomy in images, or guess where `register` refuses.

    Args:
        images: At least one, all of one size.
        source: Where they come from.
        mirrored: Whether they are seen through a mirror.
        diameter_mm: Inner diameter of the globe.
    """
    overrides = Overrides(mirrored=mirrored, diameter_mm=diameter_mm)
    try:
        anatomy = sound_anatomy(images, diameter_mm, source)
    except BadInput as error:
        still = still_picture(images)
        draft = _guessed(still.shape[1], still.shape[0], overrides)
        return Opened(source, still, None, draft, error.problem)
    draft, note = _found(anatomy, overrides, source)
    opened = Opened(source, anatomy.still, anatomy, draft, note)
    try:
        empty = find_background_image(images, anatomy.still, sound_registration(opened, draft))
    except BadInput:  # what was found must be corrected first
        return opened
    return replace(opened, background_webp=empty.webp) if empty else opened


def data_of(opened: Opened, draft: Draft) -> AnatomyPx:
    """Return a draft as the writer of registrations takes it.

    Raises:
        BadInput: If a place lies far outside the image, where a slant cannot be taken away.
    """
    height_px, width_px = opened.still.shape[:2]
    places = draft.center_px, draft.target_px, *draft.contour_px, *(t.point_px for t in draft.trocars)
    for x, y in places:
        if not (-width_px <= x <= 2 * width_px and -height_px <= y <= 2 * height_px):
            raise BadInput(f"({x:g}, {y:g}) px lies far outside the {width_px} x {height_px} px image")
    trocars = tuple(TrocarPx(trocar.name, trocar.point_px, trocar.used) for trocar in draft.trocars)
    same = {name: each for name, each in asdict(draft).items() if name != "file"}
    more = {"trocars": trocars, "background_webp": opened.background_webp}
    return AnatomyPx(width_px=width_px, height_px=height_px, **{**same, **more})


def draft_from(registration: Registration, file: str, opened: Opened) -> Draft:
    """Return the draft that a registration is which was read from a file of some name.

    Raises:
        BadInput: If it is for other images, or has what no draft can have.
    """
    data, (height_px, width_px) = anatomy_px(registration), opened.still.shape[:2]
    if (data.width_px, data.height_px) != (width_px, height_px):
        is_for = f"is for images of {data.width_px} x {data.height_px} px"
        raise BadInput(f"{is_for}, but this one is {width_px} x {height_px} px")
    trocars = tuple(DraftTrocar(each.name, each.point_px, each.used) for each in data.trocars)
    try:
        draft = replace(_draft(data, trocars), file=_line(file.replace('"', "'"))[:40])
        return msgspec.convert(msgspec.to_builtins(draft), Draft)
    except msgspec.ValidationError as error:
        raise BadInput(f"cannot be corrected here: {error}") from None


def sound_registration(opened: Opened, draft: Draft) -> Registration:
    """Return what a draft's file will say, read as every registration is.

    Raises:
        BadInput: If a run would refuse it.
    """
    text = registration_text(data_of(opened, draft), _title(opened, draft))
    return parse_registration(text, "registration")


def sound_picture(opened: Opened, draft: Draft) -> bytes:
    """Return a draft drawn over the image as a PNG, as `register` draws what it finds.

    Raises:
        BadInput: If a run would refuse it.
    """
    registration = sound_registration(opened, draft)
    return registration_picture(
        opened.still, registration, data_of(opened, draft), _how(opened, draft), opened.anatomy
    )


def _title(opened: Opened, draft: Draft) -> str:
    return f"Registration {_how(opened, draft, f' in {_line(Path(opened.source).name)}')}."


def _line(text: str) -> str:
    """Return a text for a comment, which a line's end would end."""
    return " ".join(text.split())


def _how(opened: Opened, draft: Draft, where: str = "") -> str:
    """Say where a draft comes from, and how sure that was."""
    if draft.file:
        return f"of {draft.file}, corrected by hand{where}"
    if opened.anatomy is None:
        return f"placed by hand{where}"
    by_hand = "" if draft == opened.draft else ", corrected by hand"
    doubt = in_px_and_mm(opened.anatomy.rim_uncertainty_px, draft.diameter_mm / (2 * draft.radius_px))
    return f"found by haptigraph{where}{by_hand}; globe and retina were uncertain by {doubt}"


def _found(anatomy: Anatomy, overrides: Overrides, source: str) -> tuple[Draft, str]:
    """Return what was found as a draft, and what must still be told."""
    named = named_trocars(anatomy, overrides.mirrored)
    side = "right" if overrides.mirrored else "left"  # of the surgeon, for the image's left
    note = ""
    if not named:
        x, y = anatomy.seen_px(
            _around(anatomy.center_px, WALL_MIDDLE * anatomy.radius_px, GUESSED_TROCAR_DEG - 180)
        )
        wish = f"{x},{y}"  # it stands on the image's left
        note = (
            "no trocar found: no needle moves, and no hole is seen inside the wall; "
            "drag the trocar to where the needle pivots"
        )
    else:
        wish = named[0][0]
        unclear = unclear_trocar(named)
        note = f"{unclear}; choose it" if unclear else ""
    mm_per_px = overrides.diameter_mm / (2 * anatomy.radius_px)
    data = settled(anatomy, replace(overrides, trocar=wish), mm_per_px, source)
    trocars = tuple(
        DraftTrocar(trocar.name if named else side, trocar.point_px, trocar.used) for trocar in data.trocars
    )
    return _draft(data, trocars), note


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
    )


def _guessed(width_px: int, height_px: int, overrides: Overrides) -> Draft:
    """Return an eye in the middle of the image, to be dragged to where it is."""
    center = (width_px - 1) / 2, (height_px - 1) / 2
    radius = GUESSED_RADIUS * min(width_px, height_px)
    steps = [2 * number / (GUESSED_POINTS - 1) - 1 for number in range(GUESSED_POINTS)]
    trocar = _around(center, WALL_MIDDLE * radius, GUESSED_TROCAR_DEG - 180)
    return Draft(
        mirrored=overrides.mirrored,
        diameter_mm=overrides.diameter_mm,
        center_px=center,
        radius_px=radius,
        contour_px=tuple(_around(center, radius, step * GUESSED_RETINA_DEG) for step in steps),
        target_px=_around(center, radius, 0.0),
        trocars=(DraftTrocar("right" if overrides.mirrored else "left", trocar, used=True),),
    )


def _around(center_px: Vec, radius_px: float, angle_deg: float) -> Vec:
    """Return the place at an angle from the bottom, positive to the image's right."""
    angle = math.radians(angle_deg)
    return center_px[0] + radius_px * math.sin(angle), center_px[1] + radius_px * math.cos(angle)
