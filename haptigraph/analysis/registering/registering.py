"""Make a registration: read images, find the anatomy, check it, draw it, write it, say how good it is.

Either both files are written or neither.
"""

import json
import os
import tempfile
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from pathlib import Path

from msgspec.structs import replace

from haptigraph.analysis.registering.overrides import Overrides, check_overrides, settled
from haptigraph.analysis.registering.picture import registration_picture
from haptigraph.analysis.registering.report import WALL_MM, in_px_and_mm, report_lines, wall_mm
from haptigraph.assemble import SOURCES, open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy, find_anatomy
from haptigraph.perception.anatomy.background_image import find_background_image
from haptigraph.recording.codec import decode
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import parse_registration
from haptigraph.registration.text import registration_text
from haptigraph.sources.naming import CAMERAS, split_source
from haptigraph.sources.played import played
from haptigraph.stages import Source

__all__ = [
    "all_images",
    "check_files",
    "images_of",
    "register_source",
    "sound_anatomy",
    "spread_images",
    "write_files",
]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
MOST_TILT_DEG = 20.0
MOST_OUT_OF_ROUND_MM = 0.1  # of what is left after straightening


def register_source(
    source: str,
    output: str | Path,
    overrides: Overrides,
    picture: str | Path | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> str:
    """Register a source and write the file and its picture.

    Args:
        source: An image, or anything `run` takes but a camera.
        output: The TOML to write.
        overrides: Target, trocar, scale.
        picture: The PNG to write; beside the TOML if None.
        force: Whether existing files may be overwritten.
        progress: Told how far reading is.

    Returns:
        The report, some lines of text.

    Raises:
        BadInput: If something cannot be found or used; nothing is written then.
    """
    files = Path(output), Path(picture) if picture else Path(output).with_suffix(".png")
    check_overrides(overrides)
    check_files(files, source, force=force)
    with closing(all_images(source)) as read:
        images = spread_images(read, source, overrides.images, progress)
    anatomy = sound_anatomy(images, overrides.diameter_mm, source)
    mm_per_px = overrides.diameter_mm / (2 * anatomy.radius_px)
    found = settled(anatomy, overrides, mm_per_px, source)
    doubt = f"globe and retina uncertain by {in_px_and_mm(anatomy.rim_uncertainty_px, mm_per_px)}"
    title = f"Registration found by haptigraph in {Path(source).name}; {doubt}."
    registration = parse_registration(registration_text(found, title), f"registration found in {source}")
    empty = find_background_image(images, anatomy.still, registration)
    found = replace(found, background_webp=empty.webp if empty else b"")
    drawn = registration_picture(anatomy.still, registration, found, doubt, anatomy)
    write_files(files, (registration_text(found, title).encode(), drawn))
    return "\n".join(report_lines(anatomy, found, registration, overrides, files))


def sound_anatomy(images: Sequence[Image], diameter_mm: float, source: str) -> Anatomy:
    """Find the anatomy, and refuse what is no eye.

    Raises:
        BadInput: If something cannot be found or makes no sense; it names the source.
    """
    try:
        anatomy = find_anatomy(images)
    except BadInput as error:
        raise BadInput(error.problem, source) from None
    _check_plausible(anatomy, diameter_mm / (2 * anatomy.radius_px), source)
    return anatomy


def check_files(files: tuple[Path, Path], source: str, *, force: bool) -> None:
    """Refuse to write over something, or into nothing."""
    if files[0] == files[1]:
        raise BadInput("registration and picture cannot be the same file", files[0])
    for file in files:
        if file.is_dir():
            raise BadInput("is a folder; the name of a file is needed", file)
        if file.exists() and Path(source).exists() and file.samefile(source):
            raise BadInput("is the source itself; give --picture FILE or another name", file)
        if file.exists() and not force:
            raise BadInput("exists already; --force overwrites it", file)
        if not file.parent.is_dir():
            raise BadInput("its folder does not exist", file)


def spread_images(images: Iterable[Image], source: str, most: int, progress: Progress | None) -> list[Image]:
    """Pick images spread evenly over a source of unknown length.

    Args:
        images: All of them.
        source: Named in errors.
        most: How many to return at most.
        progress: Told how far reading is.

    Raises:
        BadInput: If there are none, or they differ in size.
    """
    kept: list[Image] = []
    step = 1
    for count, image in enumerate(images):
        if count % step == 0:
            kept.append(image)
        if len(kept) == 2 * most:
            kept, step = kept[::2], 2 * step
        if progress and count % 25 == 0:
            progress("reading", count, count + 25)
    if not kept:
        raise BadInput("has no images", source)
    if any(image.shape != kept[0].shape for image in kept):
        raise BadInput("its images differ in size; all must come from one camera that stands still", source)
    picks = range(min(most, len(kept)))
    return [kept[round(number * (len(kept) - 1) / max(len(picks) - 1, 1))] for number in picks]


def all_images(uri: str) -> Generator[Image, None, None]:
    """Read an image file, or everything that a source but a camera delivers.

    Raises:
        BadInput: If it cannot be read.
    """
    file = Path(uri)
    if file.is_file() and file.suffix.lower() in PICTURES:
        try:
            yield decode(file.read_bytes())
        except ValueError:
            raise BadInput("not an image that OpenCV can read", uri) from None
        return
    if split_source(uri, SOURCES)[0] in CAMERAS:
        raise BadInput(f"{uri} cannot be registered directly; record a short clip with it and give that")
    yield from images_of(open_source(load_config(None, (f"source.uri={json.dumps(uri)}",)), VirtualClock()))


def images_of(source: Source) -> Generator[Image, None, None]:
    """Yield every image that a source delivers, and close it."""
    with closing(played(source)) as captures:
        for capture in captures:
            if capture.image is not None:
                yield capture.image


def _check_plausible(anatomy: Anatomy, mm_per_px: float, source: str) -> None:
    if anatomy.tilt is not None and anatomy.tilt.angle_deg > MOST_TILT_DEG:
        raise BadInput(
            f"the camera looks at the globe at a slant of {anatomy.tilt.angle_deg:.0f} deg, at most "
            f"{MOST_TILT_DEG:g} deg is handled; turn it to look straight at the section",
            source,
        )
    off_mm = anatomy.rim.inner.out_of_round_px * mm_per_px
    if off_mm > MOST_OUT_OF_ROUND_MM:
        raise BadInput(
            f"the globe is not round: its radius varies by {off_mm:.2f} mm either way, at most "
            f"{MOST_OUT_OF_ROUND_MM} mm is handled",
            source,
        )
    if anatomy.rim.outer is None:
        return
    thick_mm = wall_mm(anatomy, mm_per_px)
    if not WALL_MM[0] <= thick_mm <= WALL_MM[1]:
        raise BadInput(
            f"what looks like the globe has a wall of {thick_mm:.1f} mm; "
            f"{WALL_MM[0]:g} to {WALL_MM[1]:g} mm is plausible",
            source,
        )


def write_files(files: Sequence[Path], contents: Sequence[bytes]) -> None:
    """Write all files beside their places first, so that none is ever half there."""
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
