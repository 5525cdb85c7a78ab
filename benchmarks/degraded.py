"""Scores on labelled clips whose images were degraded: half size, motion blur, noise and poor JPEG.

`python benchmarks/degraded.py [FOLDER ...] [--json FILE] [--cache DIR]`. A FOLDER is a labelled clip, with
clip.mp4, registration.toml and truth.csv, or contains some; without one, these are the renderings of the
tests and the shared clips, where present. The images are degraded after decoding, nothing is rendered
again. At half size registration and truth are scaled with them. The motion blur is along a fixed direction,
30° from x towards y: it lies across some shafts and along others, and is the same whatever the needle does.
"""

import argparse
import math
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.evaluation.evaluation import Errors, errors_of
from haptigraph.analysis.evaluation.ground_truth import TruthRow, load_truth
from haptigraph.analysis.evaluation.sweep import pooled
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Capture, Image
from haptigraph.projection import Homography
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import Registration, anatomy_px
from haptigraph.registration.loading import load_camera_registration, parse_camera_registration
from haptigraph.registration.text import AnatomyPx, registration_text
from haptigraph.sim.eye.motion_blur import line_kernel
from haptigraph.sources.reading import read_images

ROOT = Path(__file__).parents[1]
DEFAULT_FOLDERS = (ROOT / "tests" / "data" / "renderings", ROOT.parent / "shared" / "clips")
CLIP_FILES = ("clip.mp4", "registration.toml", "truth.csv")
PERCEIVER = "tracker"
MOTION_PX, MOTION_DEG = 9.0, 30.0
NOISE_SD_GREY = 12.0
JPEG_QUALITY = 25
MAX_IMAGES = sys.maxsize

Degradation = Callable[[Image, np.random.Generator], Image]


def main() -> None:
    """Evaluate every clip in every variant, and print one table."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/degraded.py tests/data/renderings/golden_thin --json scores.json",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", nargs="*", type=Path, help="a labelled clip, or a folder with some")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all scores to a file")
    parser.add_argument(
        "--cache", type=Path, metavar="DIR", help="keep degraded images there, and use those kept"
    )
    given = parser.parse_args()
    try:
        folders = clips(given.folder or [folder for folder in DEFAULT_FOLDERS if folder.is_dir()])
        report(folders, given.json, given.cache)
    except BadInput as error:
        print(f"degraded: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def report(folders: Sequence[Path], output: Path | None, cache: Path | None = None) -> None:
    """Print the table, row by row, and write the JSON file.

    Raises:
        BadInput: If a clip is not valid, or the file cannot be written.
    """
    if output is not None:
        write(output, "")  # refused before the work
    print(HEAD, flush=True)
    rows: list[dict[str, Any]] = []
    errors: dict[str, list[Errors]] = {variant: [] for variant in VARIANTS}
    for folder in folders:
        for variant, degrade in VARIANTS.items():
            errors[variant].append(evaluated(folder, variant, degrade, cache))
            rows.append(scores(folder.resolve().name, variant, errors[variant][-1:]))
            print(line(rows[-1]), flush=True)
    for variant, of_clips in errors.items():
        rows.append(scores("all", variant, of_clips))
        print(line(rows[-1]))
    if output is not None:
        write(output, msgspec.json.encode({"perceiver": PERCEIVER, "rows": rows}).decode() + "\n")


def write(output: Path, text: str) -> None:
    """Write a file.

    Raises:
        BadInput: If it cannot be written.
    """
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", output) from None


def clips(folders: Sequence[Path]) -> list[Path]:
    """Return the labelled clips among folders and the folders in them.

    Raises:
        BadInput: If there is no such folder, or no clip in it.
    """
    found = []
    for folder in folders:
        if not folder.is_dir():
            raise BadInput("is no folder; give labelled clips, or folders that contain some", folder)
        inside = [each for each in (folder, *sorted(folder.iterdir())) if is_clip(each)]
        if not inside:
            raise BadInput(f"contains no labelled clip ({', '.join(CLIP_FILES)})", folder)
        found += inside
    if not found:
        raise BadInput("no labelled clips found; give their folders")
    return found


def is_clip(folder: Path) -> bool:
    """Return whether a folder holds all files of a labelled clip."""
    return all((folder / name).is_file() for name in CLIP_FILES)


def evaluated(folder: Path, variant: str, degrade: Degradation, cache: Path | None = None) -> Errors:
    """Run one variant of a clip through the pipeline and compare it with the truth.

    Raises:
        BadInput: If the clip is not valid.
    """
    config = load_config(None, (f"perception.perceiver={PERCEIVER}",))
    procedure = assemble.load_procedure(config.run.procedure)
    registration = load_camera_registration(folder / "registration.toml")
    truth = load_truth(folder / "truth.csv", [state.name for state in procedure.states])
    if variant == "half":
        registration, truth = halved_registration(registration, folder), [halved_truth(row) for row in truth]
    pipeline = assemble.build_pipeline(config, registration, procedure)
    captures = (
        captures_of(folder, variant, degrade) if cache is None else kept(cache, folder, variant, degrade)
    )
    steps = [pipeline.step(capture) for capture in islice(captures, MAX_IMAGES)]
    if len(steps) != min(len(truth), MAX_IMAGES):
        raise BadInput(f"has {len(truth)} rows, but the clip has {len(steps)} images", folder / "truth.csv")
    return errors_of(steps, truth[:MAX_IMAGES], registration.image)


def captures_of(folder: Path, variant: str, degrade: Degradation) -> Iterator[Capture]:
    """Yield the degraded images of a clip.

    Raises:
        BadInput: If the clip is not valid.
    """
    config = load_config(None, ())
    clip = replace(config.source, uri=str(folder / "clip.mp4"), loop=False)
    rng = np.random.default_rng(zlib.crc32(f"{folder.resolve().name} {variant}".encode()))
    with closing(read_images(assemble.open_source(replace(config, source=clip), VirtualClock()))) as captures:
        for capture in captures:
            image = None if capture.image is None else degrade(capture.image, rng)
            yield replace(capture, image=image, encoded=None)


def kept(cache: Path, folder: Path, variant: str, degrade: Degradation) -> Iterator[Capture]:
    """Yield the degraded images of a clip from files, which are written at first."""
    file = cache / f"{folder.resolve().name}.{variant}.npy"
    stamps = file.with_suffix(".stamps.npy")
    if not stamps.exists():
        cache.mkdir(parents=True, exist_ok=True)
        captures = list(islice(captures_of(folder, variant, degrade), MAX_IMAGES))
        np.save(file, np.array([capture.image for capture in captures]))
        np.save(stamps, np.array([capture.stamp_ns for capture in captures]))
    pairs = zip(np.load(stamps), np.load(file, mmap_mode="r"), strict=True)
    for index, (stamp_ns, image) in enumerate(pairs):
        yield Capture(index=index, stamp_ns=int(stamp_ns), image=np.array(image))


def unchanged(image: Image, _rng: np.random.Generator) -> Image:
    """Return the image as it is."""
    return image


def halved(image: Image, _rng: np.random.Generator) -> Image:
    """Return an image of half the width and height; each pixel is the mean of four."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    even = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def moving(length_px: float, angle_deg: float) -> Degradation:
    """Return what blurs an image by a straight uniform motion during the exposure."""
    kernel = line_kernel(length_px, angle_deg)
    return lambda image, _rng: np.asarray(cv2.filter2D(image, -1, kernel), np.uint8)


def adding_noise(sd_grey: float) -> Degradation:
    """Return what adds Gaussian noise to an image, independent in every pixel and colour."""

    def noisy(image: Image, rng: np.random.Generator) -> Image:
        noise = rng.standard_normal(image.shape, np.float32) * np.float32(sd_grey)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)

    return noisy


def compressing(quality: int) -> Degradation:
    """Return what makes an image what it is after JPEG compression."""

    def compressed(image: Image, _rng: np.random.Generator) -> Image:
        encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), np.uint8)

    return compressed


moved = moving(MOTION_PX, MOTION_DEG)
noisy = adding_noise(NOISE_SD_GREY)
compressed = compressing(JPEG_QUALITY)

VARIANTS: dict[str, Degradation] = {
    "full": unchanged,
    "half": halved,
    "motion": moved,
    "noise": noisy,
    "jpeg": compressed,
}


def halved_px(at_px: Vec) -> Vec:
    """Return where a position of an image is at half its size; pixel centres have integer positions."""
    return (at_px[0] + 0.5) / 2 - 0.5, (at_px[1] + 0.5) / 2 - 0.5


def halved_truth(row: TruthRow) -> TruthRow:
    """Return the ground truth of an image at half its size."""
    return replace(row, tip_px=row.tip_px and halved_px(row.tip_px))


def halved_registration(registration: Registration, folder: Path) -> Registration:
    """Return a registration for images of half the size.

    Raises:
        BadInput: If the globe is then too small.
    """
    text = registration_text(halved_anatomy(anatomy_px(registration)), "Registration at half the size.")
    return parse_camera_registration(text, f"{folder / 'registration.toml'} at half the size")


def halved_anatomy(anatomy: AnatomyPx) -> AnatomyPx:
    """Return the anatomy in an image of half the size, with its homography and reference image."""
    return replace(
        anatomy,
        width_px=anatomy.width_px // 2,
        height_px=anatomy.height_px // 2,
        center_px=halved_px(anatomy.center_px),
        radius_px=anatomy.radius_px / 2,
        contour_px=tuple(halved_px(point) for point in anatomy.contour_px),
        target_px=halved_px(anatomy.target_px),
        trocars=tuple(replace(each, point_px=halved_px(each.point_px)) for each in anatomy.trocars),
        frontal_from_image=anatomy.frontal_from_image and halved_homography(anatomy.frontal_from_image),
        background_webp=halved_background(anatomy.background_webp),
    )


def halved_homography(frontal_from_image: Homography) -> Homography:
    """Return a homography between images of half the size."""
    half_from_full = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    matrix = half_from_full @ frontal_from_image.matrix @ np.linalg.inv(half_from_full)
    first, second, third = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix / matrix[2, 2])
    return Homography((first, second, third))


def halved_background(webp: bytes) -> bytes:
    """Return a reference image at half its size; known is what all four pixels show."""
    background = BackgroundImage.of_webp(webp)
    if background is None:
        return b""
    known = halved(background.is_known.astype(np.uint8) * 255, np.random.default_rng(0)) == 255
    return BackgroundImage(halved(background.image, np.random.default_rng(0)), known).webp


COLUMNS = (
    ("clip", -18),
    ("variant", -8),
    (">=2mm", 6),  # images with at least 2 mm of needle inside
    ("known", 8),
    ("far", 8),
    ("missed", 7),
    ("wrong", 6),
    ("false", 6),
    ("bias px", 8),
    ("tip z p68/p95/p997", 19),
    ("tip px p50/p95", 15),
    ("deg p95", 8),  # beyond 3 mm
    ("states", 8),
)
HEAD = "".join(f"{name:{'<' if width < 0 else '>'}{abs(width)}}" for name, width in COLUMNS)


def scores(clip: str, variant: str, errors: Sequence[Errors]) -> dict[str, Any]:
    """Return the scores of one row; docs/reference/conventions.md defines them."""
    deep = sum(len(each.expected) for each in errors)
    return {"clip": clip, "variant": variant, "images_2mm_inside": deep, **pooled(errors)}


def line(row: dict[str, Any]) -> str:
    """Return one row of the table."""
    tip_px = row["tip_error_px"]
    cells = (
        row["clip"],
        row["variant"],
        str(row["images_2mm_inside"]),
        percent(row["tip_known_rate"]),
        percent(row["tip_far_rate"]),
        str(row["missed_contact_images"]),
        str(row["wrong_contact_images"]),
        str(row["false_detections"]),
        number(row["tip_bias_px"], "+"),
        "/".join(number(value) for value in row["tip_z"].values()),
        f"{number(tip_px['median'])}/{number(tip_px['p95'])}",
        number(row["angle_error_deg"]["deep"]["p95"]),
        percent(row["state_agreement"]),
    )
    return "".join(
        f"{cell:{'<' if width < 0 else '>'}{abs(width)}}"
        for cell, (_, width) in zip(cells, COLUMNS, strict=True)
    )


def number(value: float | None, sign: str = "") -> str:
    """Return a number with two decimals, or a dash."""
    return "-" if value is None or math.isnan(value) else f"{value:{sign}.2f}"


def percent(value: float | None) -> str:
    """Return a share in percent, or a dash."""
    return "-" if value is None else f"{100 * value:.1f} %"


if __name__ == "__main__":
    main()
