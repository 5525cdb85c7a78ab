"""Calibrate a camera: read a source, find the sheet, fit the lens, write lens.toml, report."""

import math
from collections.abc import Generator, Iterable
from contextlib import closing
from pathlib import Path

import numpy as np

from haptigraph.analysis.calibrating.board import Board, View
from haptigraph.analysis.calibrating.calibration import MIN_COVERAGE, Calibration, calibrate, coverage
from haptigraph.analysis.calibrating.factory import factory_lens
from haptigraph.analysis.registering.registering import all_images, check_files
from haptigraph.assemble import SOURCES, is_live, open_source
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config, SourceConfig, load_config
from haptigraph.errors import BadInput
from haptigraph.files import write_files
from haptigraph.imaging import UPRIGHT
from haptigraph.lens import Lens
from haptigraph.messages import Image
from haptigraph.recording.writer import Progress
from haptigraph.registration.lens_file import LensFile, LensImage, Parameters, Quality, lens_file_text
from haptigraph.sources.naming import split_source
from haptigraph.sources.reading import read_images

__all__ = ["calibrate_camera", "distortion_text", "find_views", "read_factory_lens"]

MAX_VIEWS = 30
ENOUGH_VIEWS = 20
MIN_MOTION = 0.03
"""Mean motion of the corners, relative to the image's width, that makes a picture a new view."""
MIN_SHARED = 0.6
CAMERA_PX = 1280, 720


def calibrate_camera(
    source: str,
    output: Path,
    board: Board,
    settings: tuple[str, ...] = (),
    *,
    duration_s: float,
    force: bool,
    progress: Progress | None = None,
) -> str:
    """Calibrate a camera by pictures of the sheet, and write lens.toml.

    Args:
        source: A camera, a video, or a folder of pictures.
        output: The file to write.
        board: The board on the sheet.
        settings: `key=value` of the source.
        duration_s: Time after which a camera is no longer read.
        force: Whether to overwrite an existing file.
        progress: Called with the number of views found.

    Returns:
        The report, several lines of text.

    Raises:
        BadInput: If the source cannot be read, or does not determine the lens; then no file is written.
    """
    config = _check(source, output, settings, force=force)
    with closing(_images(config, duration_s)) as images:
        views, size_px = find_views(images, board, source, progress)
    try:
        found = calibrate(views, size_px)
    except BadInput as error:
        raise BadInput(error.problem, source) from None
    sd = Parameters(found.sd.focal_px, found.sd.principal_px, found.sd.distortion)
    quality = Quality(found.rms_px, found.views, found.coverage)
    camera = f"{Path(source).name} with a sheet of {board.columns} x {board.rows} squares"
    file = LensFile(1, LensImage(*size_px), found.lens, camera, sd, quality)
    write_files((output,), (lens_file_text(file).encode(),))
    return "\n".join([*_lens_lines(found.lens, size_px), *_quality_lines(found), *_written(output)])


def read_factory_lens(source: str, output: Path, settings: tuple[str, ...] = (), *, force: bool) -> str:
    """Write the lens that the RealSense SDK reports as lens.toml; arguments as of `calibrate_camera`.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If the source is no RealSense camera or recording of the SDK.
    """
    config = _check(source, output, settings, force=force)
    kind, argument = split_source(source, SOURCES)
    if kind not in ("realsense", "realsense-file"):
        problem = (
            f"{source} reports no calibration; --factory is for realsense[:SERIAL] and recordings of its SDK"
        )
        raise BadInput(problem)
    is_live = kind == "realsense"
    size, rate = (_size_px(config.source), config.source.rate_hz) if is_live else (None, None)
    lens, size_px, camera = factory_lens(kind, argument, size, rate)
    text = lens_file_text(
        LensFile(1, LensImage(*size_px), lens, f"{camera}, as its manufacturer calibrated it")
    )
    write_files((output,), (text.encode(),))
    unknown = "uncertainty    not stated by the manufacturer"
    return "\n".join([f"camera         {camera}", *_lens_lines(lens, size_px), unknown, *_written(output)])


def find_views(
    images: Iterable[Image], board: Board, source: str, progress: Progress | None = None
) -> tuple[list[View], tuple[int, int]]:
    """Return different views of the board, at most 60, or 30 that cover the image, and the images' size.

    Raises:
        BadInput: If there are no images, they differ in size, or none shows the board.
    """
    views: list[View] = []
    size_px: tuple[int, int] | None = None
    for image in images:
        height_px, width_px = image.shape[:2]
        if size_px not in (None, (width_px, height_px)):
            raise BadInput("its images differ in size; all must come from one camera", source)
        size_px = width_px, height_px
        view = board.find(image)
        if view is not None and all(_differ(view, other, width_px) for other in views):
            views.append(view)
        if progress:
            progress("views of the sheet", len(views), ENOUGH_VIEWS)
        is_covered = len(views) == MAX_VIEWS and coverage(views, size_px) >= MIN_COVERAGE
        if is_covered or len(views) == 2 * MAX_VIEWS:
            break
    if size_px is None:
        raise BadInput("has no images", source)
    if not views:
        squares = f"{board.columns}x{board.rows}"
        raise BadInput(
            f"no sheet of {squares} squares was found in it; print one with `haptigraph calibrate sheet`, or "
            "give its --squares",
            source,
        )
    return views, size_px


def distortion_text(lens: Lens, size_px: tuple[int, int]) -> str:
    """Describe the distortion by how far the middle of the sides and the farthest corner are moved."""
    (x, y), (width, height) = lens.principal_px, size_px
    shares = []
    for place in ((width - 1, y), (max((0, width - 1), key=lambda at: abs(at - x)), height - 1)):
        ideal = lens.undistorted((float(place[0]), float(place[1])))
        shares.append(math.dist(place, (x, y)) / math.dist(ideal, (x, y)) - 1)
    return f"{shares[0]:+.1%} at the right side, {shares[1]:+.1%} in a corner (negative: barrel)"


def _differ(one: View, other: View, width_px: int) -> bool:
    shared, at_one, at_other = np.intersect1d(one.numbers, other.numbers, return_indices=True)
    if len(shared) < MIN_SHARED * min(len(one.numbers), len(other.numbers)):
        return True
    motion = np.linalg.norm(one.points_px[at_one] - other.points_px[at_other], axis=1)
    return bool(motion.mean() > MIN_MOTION * width_px)


def _check(source: str, output: Path, settings: tuple[str, ...], *, force: bool) -> Config:
    """Return the settings; refuse those that turn or crop, and a file that exists."""
    check_files((output,), source, force=force)
    config = load_config(None, (f"source.uri={source}", *settings))
    if config.source.turn != UPRIGHT or config.source.crop_px:
        raise BadInput(
            "a lens is calibrated in images as the camera takes them; leave out rotation, mirror, crop"
        )
    return config


def _images(config: Config, duration_s: float) -> Generator[Image, None, None]:
    if not is_live(split_source(config.source.uri, SOURCES)[0]):
        yield from all_images(config.source.uri)
        return
    first_ns = None
    with closing(read_images(open_source(config, MonotonicClock(), _size_px(config.source)))) as captures:
        for capture in captures:
            first_ns = capture.stamp_ns if first_ns is None else first_ns
            if capture.stamp_ns - first_ns > duration_s * 1e9:
                return
            if capture.image is not None:
                yield capture.image


def _size_px(config: SourceConfig) -> tuple[int, int]:
    return (config.width_px, config.height_px) if config.width_px else CAMERA_PX


def _lens_lines(lens: Lens, size_px: tuple[int, int]) -> list[str]:
    (across, down), (x, y) = lens.focal_px, lens.principal_px
    return [
        f"focal length   {across:.1f} x {down:.1f} px, principal point ({x:.1f}, {y:.1f}) px",
        f"distortion     {distortion_text(lens, size_px)}",
    ]


def _quality_lines(found: Calibration) -> list[str]:
    sd = found.sd
    return [
        f"residual       {found.rms_px:.2f} px (RMS) in {found.views} views",
        f"coverage       {found.coverage:.0%} of the image",
        f"uncertainty    corrected points {found.lens.sd_px:.2f} px at the worst place; focal length "
        f"{max(sd.focal_px):.2f} px, principal point {max(sd.principal_px):.2f} px",
    ]


def _written(output: Path) -> list[str]:
    return [f"written        {output}; register with: haptigraph register SOURCE --lens {output} -o eye.toml"]
