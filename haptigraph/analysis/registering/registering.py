"""Register a source: read images, find and check the anatomy, write the registration and a picture, report.

Writes both files or neither.
"""

from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from pathlib import Path

from msgspec.structs import replace

from haptigraph.analysis.registering.against_design import design_lines
from haptigraph.analysis.registering.depth import section_in_depth
from haptigraph.analysis.registering.design import load_design
from haptigraph.analysis.registering.overrides import (
    NOT_UPRIGHT,
    Overrides,
    apply_overrides,
    check_overrides,
)
from haptigraph.analysis.registering.picture import registration_picture
from haptigraph.analysis.registering.report import WALL_MM, in_px_and_mm, report_lines, upright_line, wall_mm
from haptigraph.assemble import SOURCES, is_live, open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.errors import BadInput
from haptigraph.files import write_files
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.lens import Lens
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy, find_anatomy
from haptigraph.perception.anatomy.background_image import find_background_image
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.perception.anatomy.upright import enters_above
from haptigraph.recording.codec import decode
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.lens_file import load_lens
from haptigraph.registration.loading import parse_camera_registration, parse_registration
from haptigraph.registration.text import registration_text
from haptigraph.sources.naming import split_source
from haptigraph.sources.reading import SpreadImages, read_images
from haptigraph.stages import Source

__all__ = [
    "all_images",
    "check_files",
    "images_of",
    "plausible_anatomy",
    "recorded_turn",
    "register_source",
    "spread_images",
]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
MAX_TILT_DEG = 20.0
FINDING, STAGES = "finding the eye", 3
MAX_OUT_OF_ROUND_MM = 0.1  # after tilt correction


def register_source(
    source: str,
    output: str | Path,
    overrides: Overrides,
    picture: str | Path | None = None,
    *,
    rig: str | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> str:
    """Register a source and write the registration and its picture.

    Args:
        source: An image, or anything `run` takes except a camera.
        output: The TOML file to write.
        overrides: Target, trocar, scale.
        picture: The PNG file to write; beside the TOML file if None.
        rig: The rig.toml of the set-up, as a prior of what is found; None: not known.
        force: Whether to overwrite existing files.
        progress: Called with the progress.

    Returns:
        The report, several lines of text.

    Raises:
        BadInput: If something cannot be found or used; then no file is written.
    """
    files = Path(output), Path(picture) if picture else Path(output).with_suffix(".png")
    check_overrides(overrides)
    design = load_design(rig) if rig else None
    overrides = design.stated(overrides) if design else overrides
    check_files(files, source, force=force)
    report = progress or (lambda *_: None)
    with closing(all_images(source, overrides.turn)) as available:
        images = spread_images(available, source, overrides.images, progress)
    report(FINDING, 0, STAGES)
    overrides = replace(overrides, turn=recorded_turn(source) or overrides.turn)
    if design:
        design.check_images(images[0], overrides, source)
    expected, lens = design.expected if design else None, _lens(overrides, images)
    anatomy = plausible_anatomy(images, overrides.globe_mm, source, expected=expected, lens=lens)
    has_target = overrides.target is None and overrides.target_mm is None
    report(FINDING, 1, STAGES)
    seen = anatomy
    if design:
        angles = design.estimated(seen)
        anatomy = design.completed(seen, angles)
        overrides = design.placed(overrides, anatomy, angles)
    above = enters_above(images, anatomy)
    if overrides.trocar is None and above is False:
        raise BadInput(f"{NOT_UPRIGHT}; if it is upright, give --trocar", source)
    mm_per_px = overrides.globe_mm / (2 * anatomy.radius_px)
    found = apply_overrides(anatomy, overrides, mm_per_px, source)
    found = replace(found, depth=section_in_depth(source, anatomy, found) if found.turn == UPRIGHT else None)
    uncertainty = f"globe and retina uncertain by {in_px_and_mm(anatomy.rim_uncertainty_px, mm_per_px)}"
    title = f"Registration found by haptigraph in {Path(source).name}; {uncertainty}."
    registration = parse_camera_registration(
        registration_text(found, title), f"registration found in {source}"
    )
    report(FINDING, 2, STAGES)
    background = find_background_image(images, anatomy.reference_image, registration)
    found = replace(found, background_webp=background.webp if background else b"")
    png = registration_picture(anatomy.reference_image, registration, found, uncertainty, anatomy)
    write_files(files, (registration_text(found, title).encode(), png))
    report(FINDING, 3, STAGES)
    lines = design_lines(design, seen, angles, found, has_target=has_target) if design else []
    if not (design and seen.trocars):  # which compares them
        lines = [upright_line(anatomy, enters_above=above), *lines]
    return "\n".join(report_lines(anatomy, found, registration, overrides, files, lines))


def _lens(overrides: Overrides, images: Sequence[Image]) -> Lens | None:
    if overrides.lens is None:
        return None
    height_px, width_px = images[0].shape[:2]
    return load_lens(overrides.lens).for_images((width_px, height_px), overrides.turn, overrides.lens)


def plausible_anatomy(
    images: Sequence[Image],
    diameter_mm: float,
    source: str,
    *,
    expected: Expected | None = None,
    lens: Lens | None = None,
) -> Anatomy:
    """Find the anatomy, where it is expected if its design is known; refuse what is not a plausible eye.

    Raises:
        BadInput: If something cannot be found or is implausible; it names the source.
    """
    try:
        anatomy = find_anatomy(images, expected=expected, lens=lens)
    except BadInput as error:
        raise BadInput(error.problem, source) from None
    _check_plausible(anatomy, diameter_mm / (2 * anatomy.radius_px), source)
    return anatomy


def check_files(files: tuple[Path, ...], source: str, *, force: bool) -> None:
    """Refuse files that cannot be written or must not be overwritten."""
    if len(set(files)) < len(files):
        raise BadInput("registration and picture cannot be the same file; give --picture FILE", files[0])
    for file in files:
        if file.is_dir():
            raise BadInput("is a folder; give the name of a file", file)
        if file.exists() and Path(source).exists() and file.samefile(source):
            other = file.with_stem(f"{file.stem}_registration")
            option = f"the picture; add --picture {other}" if file == files[-1] else f"-o; use -o {other}"
            raise BadInput(f"is the source, and would be overwritten by {option}", file)
        if file.exists() and not force:
            raise BadInput("exists already; --force overwrites it", file)
        if not file.parent.is_dir():
            raise BadInput("its folder does not exist; create it first", file)


def spread_images(
    images: Iterable[Image], source: str, max_images: int, progress: Progress | None
) -> list[Image]:
    """Pick images evenly spread over a source of unknown length.

    Args:
        images: All images of the source.
        source: Its name in errors.
        max_images: How many to return at most.
        progress: Called with the progress of reading.

    Raises:
        BadInput: If there are none, or they differ in size.
    """
    spread = SpreadImages(max_images)
    for count, image in enumerate(images):
        spread.add(image)
        if progress and count % 25 == 0:
            progress("reading", count, count + 25)
    if progress and spread.held:
        progress("reading", count + 1, count + 1)
    if not spread.held:
        raise BadInput("has no images", source)
    if any(image.shape != spread.held[0].shape for image in spread.held):
        raise BadInput("its images differ in size; all must come from one camera at rest", source)
    return spread.picked


def all_images(uri: str, turn: Turn = UPRIGHT) -> Generator[Image, None, None]:
    """Yield the image of a file, or all images of a source that is not a camera, turned.

    Raises:
        BadInput: If it cannot be read.
    """
    file = Path(uri)
    if file.is_file() and file.suffix.lower() in PICTURES:
        try:
            yield turn(decode(file.read_bytes()))
        except ValueError:
            raise BadInput("not an image that OpenCV can read", uri) from None
        return
    if is_live(split_source(uri, SOURCES)[0]):
        raise BadInput(f"{uri} cannot be registered directly; record a short clip with it and register that")
    config = Config(SourceConfig(uri=uri, rotate_deg=turn.rotate_deg, mirror=turn.mirror))
    yield from images_of(open_source(config, VirtualClock()))


def recorded_turn(uri: str) -> Turn | None:
    """Return how the images in a recording were turned; None if the source is none."""
    if split_source(uri, SOURCES)[0] != "recording":
        return None
    return parse_registration(RunReader(uri).info.registration, f"registration in {uri}").turn


def images_of(source: Source) -> Generator[Image, None, None]:
    """Yield all images of a source, and close it."""
    with closing(read_images(source)) as captures:
        for capture in captures:
            if capture.image is not None:
                yield capture.image


def _check_plausible(anatomy: Anatomy, mm_per_px: float, source: str) -> None:
    if anatomy.tilt is not None and anatomy.tilt.angle_deg > MAX_TILT_DEG:
        raise BadInput(
            f"the camera is tilted by {anatomy.tilt.angle_deg:.0f} deg, at most {MAX_TILT_DEG:g} deg is "
            "supported; point it perpendicularly at the section",
            source,
        )
    off_mm = anatomy.rim.inner.out_of_round_px * mm_per_px
    if off_mm > MAX_OUT_OF_ROUND_MM:
        raise BadInput(
            f"the globe is not round: its radius varies by {off_mm:.2f} mm either way, at most "
            f"{MAX_OUT_OF_ROUND_MM} mm is supported",
            source,
        )
    if anatomy.rim.outer is None:
        return
    thickness_mm = wall_mm(anatomy, mm_per_px)
    if not WALL_MM[0] <= thickness_mm <= WALL_MM[1]:
        raise BadInput(
            f"the globe's wall has an implausible thickness of {thickness_mm:.1f} mm; "
            f"{WALL_MM[0]:g} to {WALL_MM[1]:g} mm is plausible",
            source,
        )
