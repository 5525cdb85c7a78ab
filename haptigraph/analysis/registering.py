"""Make a registration: read images, find the anatomy, check it, draw it, write it, say how good it is.

Either both files are written or neither.
"""

import math
import os
import tempfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from msgspec import Struct

from haptigraph.analysis.registration_picture import registration_picture
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.geometry import Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy import Anatomy, FoundTrocar, find_anatomy
from haptigraph.perception.registration import DIAMETER_RANGE_MM, Registration, parse_registration
from haptigraph.recording.codec import decode
from haptigraph.recording.writer import Progress
from haptigraph.registration_text import AnatomyPx, TrocarPx, registration_text

__all__ = ["Wishes", "register_source"]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
SNAP_MM = 1.5  # so far off the retina a target given in pixels may lie
WALL_MM = (0.3, 4.0)  # plausible thickness
MOST_OUT_OF_ROUND_MM = 0.35
UNSURE_PX = 5.0


class Wishes(Struct, frozen=True):
    """What the user says about the set-up."""

    target: str | None = None
    target_mm: float | None = None
    trocar: str | None = None
    mirrored: bool = True
    diameter_mm: float = 24.0
    images: int = 40


def register_source(
    source: str,
    output: str | Path,
    wishes: Wishes,
    picture: str | Path | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> str:
    """Register a source and write the file and its picture.

    Args:
        source: An image, or anything `run` takes but a camera.
        output: The TOML to write.
        wishes: Target, trocar, scale.
        picture: The PNG to write; beside the TOML if None.
        force: Whether existing files may be overwritten.
        progress: Told how far reading is.

    Returns:
        The report, some lines of text.

    Raises:
        BadInput: If something cannot be found or used; nothing is written then.
    """
    files = Path(output), Path(picture) if picture else Path(output).with_suffix(".png")
    _check_wishes(files, wishes, force)
    images = _spread_images(source, wishes.images, progress)
    try:
        anatomy = find_anatomy(images)
    except BadInput as error:
        raise BadInput(error.problem, source) from None
    mm_per_px = wishes.diameter_mm / (2 * anatomy.radius_px)
    _check_plausible(anatomy, mm_per_px, source)
    found = _as_registration(anatomy, wishes, mm_per_px, source)
    text = registration_text(found, f"Registration found by haptigraph in {Path(source).name}.")
    registration = parse_registration(text, f"registration found in {source}")
    _write(files, (text.encode(), registration_picture(anatomy, registration, found)))
    return "\n".join(_report(anatomy, found, registration, wishes, files))


def _check_wishes(files: tuple[Path, Path], wishes: Wishes, force: bool) -> None:
    if files[0] == files[1]:
        raise BadInput("registration and picture cannot be the same file", files[0])
    for file in files:
        if file.is_dir():
            raise BadInput("is a folder; the name of a file is needed", file)
        if file.exists() and not force:
            raise BadInput("exists already; --force overwrites it", file)
        if not file.parent.is_dir():
            raise BadInput("its folder does not exist", file)
    if wishes.target is not None and wishes.target_mm is not None:
        raise BadInput("--target and --target-mm say the same thing twice; give one")
    if wishes.images < 1:
        raise BadInput(f"--images {wishes.images}; at least 1 is needed")
    low, high = DIAMETER_RANGE_MM
    if not low <= wishes.diameter_mm <= high:
        raise BadInput(
            f"--diameter-mm {wishes.diameter_mm:g} is not an eye; {low:g} to {high:g} is plausible"
        )
    for option, text in (("--target", wishes.target), ("--trocar", wishes.trocar)):
        if text is not None and not (option == "--trocar" and text in ("left", "right")):
            _place(option, text)


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


def _spread_images(uri: str, most: int, progress: Progress | None) -> list[Image]:
    """Read images spread evenly over a source of unknown length, at most so many."""
    file = Path(uri)
    if file.is_file() and file.suffix.lower() in PICTURES:
        try:
            return [decode(file.read_bytes())]
        except ValueError:
            raise BadInput("not an image that OpenCV can read", uri) from None
    if uri.startswith("camera:"):
        raise BadInput(f"{uri} cannot be registered directly; record a short clip with it and give that")
    settings = (f"source.uri={uri}",) if ":" in uri else (f"source.uri='{uri}'",)
    source = open_source(load_config(None, settings), VirtualClock())
    kept: list[Image] = []
    step = count = 0
    step = 1
    try:
        while True:
            capture = source.read(1.0)
            if capture is None or capture.image is None:
                continue
            if count % step == 0:
                kept.append(capture.image)
            count += 1
            if len(kept) == 2 * most:
                kept, step = kept[::2], 2 * step
            if progress and count % 25 == 0:
                progress("reading", count, count + 25)
    except EndOfSource:
        pass
    finally:
        source.close()
    if not kept:
        raise BadInput("has no images", uri)
    if any(image.shape != kept[0].shape for image in kept):
        raise BadInput("its images differ in size; all must come from one camera that stands still", uri)
    return (
        [kept[round(number * (len(kept) - 1) / max(most - 1, 1))] for number in range(most)]
        if len(kept) > most
        else kept
    )


def _check_plausible(anatomy: Anatomy, mm_per_px: float, source: str) -> None:
    off_mm = anatomy.rim.inner.out_of_round_px * mm_per_px
    if off_mm > MOST_OUT_OF_ROUND_MM:
        raise BadInput(
            f"the globe is seen at a slant: its radius varies by {off_mm:.2f} mm either way, at most "
            f"{MOST_OUT_OF_ROUND_MM} mm is handled; turn the camera to look straight at the section",
            source,
        )
    if anatomy.rim.outer is None:
        return
    wall_mm = _wall_mm(anatomy, mm_per_px)
    if not WALL_MM[0] <= wall_mm <= WALL_MM[1]:
        raise BadInput(
            f"what looks like the globe has a wall of {wall_mm:.1f} mm; {WALL_MM[0]:g} to {WALL_MM[1]:g} mm is "
            "plausible",
            source,
        )


def _wall_mm(anatomy: Anatomy, mm_per_px: float) -> float:
    inner, outer = anatomy.rim.inner, anatomy.rim.outer
    return (outer.radius_px - inner.radius_px) / anatomy.rim_scale * mm_per_px if outer else math.nan


def _as_registration(anatomy: Anatomy, wishes: Wishes, mm_per_px: float, source: str) -> AnatomyPx:
    trocars = _named(anatomy, wishes.mirrored)
    return AnatomyPx(
        width_px=anatomy.still.shape[1],
        height_px=anatomy.still.shape[0],
        mirrored=wishes.mirrored,
        center_px=anatomy.center_px,
        radius_px=anatomy.radius_px,
        diameter_mm=wishes.diameter_mm,
        contour_px=anatomy.contour_px[:: -1 if wishes.mirrored else 1],
        target_px=_target(anatomy, wishes, mm_per_px, source),
        trocars=_with_used(trocars, anatomy, wishes.trocar, source),
    )


def _named(anatomy: Anatomy, mirrored: bool) -> list[tuple[str, FoundTrocar]]:
    """Name trocars by the surgeon's side; a second one on the same side has a number."""
    named: list[tuple[str, FoundTrocar]] = []
    for trocar in anatomy.trocars:
        side = "right" if (trocar.angle_deg > 0) != mirrored else "left"
        same = sum(name.startswith(side) for name, _ in named)
        named.append((f"{side} {same + 1}" if same else side, trocar))
    return named


def _with_used(
    named: Sequence[tuple[str, FoundTrocar]], anatomy: Anatomy, wish: str | None, source: str
) -> tuple[TrocarPx, ...]:
    """Settle which trocar is in use: the user's word, the moving needle, or the only hole."""
    told = ", ".join(f"{name} at ({t.point_px[0]:.0f}, {t.point_px[1]:.0f}) px" for name, t in named)
    if wish and "," in wish:
        place = _place("--trocar", wish)
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
    elif named[0][1].by == "needle" or len(named) == 1:
        used = named[0][0]
    else:
        raise BadInput(f"no needle moves to show which trocar is in use; give --trocar: {told}", source)
    return tuple(TrocarPx(name, trocar.point_px, name == used) for name, trocar in named)


def _target(anatomy: Anatomy, wishes: Wishes, mm_per_px: float, source: str) -> Vec:
    """Return the target on the retina: the place nearest to the given one, or so far along it."""
    contour = anatomy.contour_px
    if wishes.target is not None:
        place = _place("--target", wishes.target)
        nearest = min(
            (_nearest(place, a, b) for a, b in pairwise(contour)), key=lambda p: math.dist(p, place)
        )
        off_mm = math.dist(nearest, place) * mm_per_px
        if off_mm > SNAP_MM:
            raise BadInput(
                f"--target {wishes.target} lies {off_mm:.1f} mm off the retina; at most {SNAP_MM} mm is moved onto it",
                source,
            )
        return nearest
    wanted_mm = wishes.target_mm or 0.0
    angle = wanted_mm / (wishes.diameter_mm / 2) * (-1 if wishes.mirrored else 1)
    x, y = anatomy.center_px
    ends = [math.atan2(p[0] - x, p[1] - y) for p in (contour[0], contour[-1])]
    if not math.isfinite(angle) or not min(ends) <= angle <= max(ends):
        reach_mm = max(ends) * wishes.diameter_mm / 2
        raise BadInput(
            f"--target-mm {wanted_mm:g} is beyond the retina, which reaches {reach_mm:.1f} mm either way"
        )
    way = math.sin(angle), math.cos(angle)
    far = x + 2 * anatomy.radius_px * way[0], y + 2 * anatomy.radius_px * way[1]
    return min((_crossing((x, y), far, a, b) for a, b in pairwise(contour)), key=lambda hit: hit[0])[1]


def _nearest(place: Vec, a: Vec, b: Vec) -> Vec:
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = ((place[0] - a[0]) * dx + (place[1] - a[1]) * dy) / (dx * dx + dy * dy)
    share = min(max(share, 0.0), 1.0)
    return a[0] + share * dx, a[1] + share * dy


def _crossing(start: Vec, end: Vec, a: Vec, b: Vec) -> tuple[float, Vec]:
    """Return how far outside the piece a-b the way from start to end crosses its line, and where."""
    way, piece = (end[0] - start[0], end[1] - start[1]), (b[0] - a[0], b[1] - a[1])
    turn = way[0] * piece[1] - way[1] * piece[0]
    if turn == 0:
        return math.inf, a
    share = ((a[0] - start[0]) * way[1] - (a[1] - start[1]) * way[0]) / turn
    return max(-share, share - 1, 0.0), (a[0] + share * piece[0], a[1] + share * piece[1])


def _write(files: tuple[Path, Path], contents: tuple[bytes, bytes]) -> None:
    """Write both files beside their places first, so that neither is ever half there."""
    ready: list[tuple[str, Path]] = []
    try:
        for file, content in zip(files, contents, strict=True):
            handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
            ready.append((name, file))
            with os.fdopen(handle, "wb") as part:
                part.write(content)
        for name, file in ready:
            Path(name).chmod(0o644)
            Path(name).replace(file)
    finally:
        for name, _ in ready:
            Path(name).unlink(missing_ok=True)


def _report(
    anatomy: Anatomy, found: AnatomyPx, registration: Registration, wishes: Wishes, files: tuple[Path, Path]
) -> list[str]:
    mm, inner, outer = registration.image.mm_per_px, anatomy.rim.inner, anatomy.rim.outer
    lines = [
        f"globe      centre ({found.center_px[0]:.1f}, {found.center_px[1]:.1f}) px, radius "
        f"{found.radius_px:.1f} px; residual {_both(inner.residual_px, mm)} on {inner.support:.0%} of its edge",
        f"tilt       radius varies by {_both(inner.out_of_round_px, mm)} either way; the mean circle is kept",
        f"scale      {mm:.5f} mm/px, from a diameter of {found.diameter_mm:g} mm",
    ]
    if outer is not None:
        lines.append(
            f"check      at this scale the wall is {_wall_mm(anatomy, mm):.2f} mm thick (plausible: 0.3 to 4)"
        )
    else:
        lines.append("check      the wall's outer edge is not seen: make sure that the inner one was found")
    lines += _rim_lines(anatomy)
    lines.append(
        f"retina     {len(found.contour_px)} points, {anatomy.refined} of them where the edge was seen"
    )
    for (name, trocar), kept in zip(_named(anatomy, wishes.mirrored), found.trocars, strict=False):
        if kept.name == name:
            lines.append(_trocar_line(anatomy, trocar, kept, registration))
    x_mm, y_mm = registration.target.at_mm
    default = wishes.target is None and wishes.target_mm is None
    lines.append(
        f"target     ({found.target_px[0]:.1f}, {found.target_px[1]:.1f}) px, "
        f"{math.atan2(x_mm, -y_mm) * registration.globe.radius_mm:+.2f} mm along the retina"
        + (" (not given: its bottom; --target or --target-mm moves it)" if default else "")
    )
    return [*lines, f"written    {files[0]}\npicture    {files[1]}"]


def _rim_lines(anatomy: Anatomy) -> list[str]:
    if anatomy.pivot is None:
        return [
            "rim        no needle moves: taken to lie in the section; if it stands before it, the scale is off"
        ]
    if anatomy.pivot.radial_sd_px > UNSURE_PX:
        return ["rim        the needle turns too little to tell whether the rim stands before the section"]
    return [
        f"rim        seen {anatomy.rim_scale - 1:.1%} larger than the section, by where the needle pivots"
    ]


def _trocar_line(anatomy: Anatomy, trocar: FoundTrocar, kept: TrocarPx, registration: Registration) -> str:
    mm = registration.image.mm_per_px
    out_mm = math.dist(trocar.point_px, anatomy.center_px) * mm - registration.globe.radius_mm
    how = "by the hole's mouth"
    if trocar.by == "needle" and anatomy.pivot is not None:
        how = f"by {anatomy.pivot.lines} shaft lines, residual {_both(anatomy.pivot.residual_px, mm)}"
    used = ", in use" if kept.used else ""
    x, y = trocar.point_px
    return (
        f"trocar     {kept.name}{used}: ({x:.1f}, {y:.1f}) px, {out_mm:.2f} mm outside the inner edge, {how}"
    )


def _both(length_px: float, mm_per_px: float) -> str:
    return f"{length_px:.2f} px ({length_px * mm_per_px:.3f} mm)"
