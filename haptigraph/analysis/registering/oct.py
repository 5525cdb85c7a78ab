"""Register B-scans or volumes: check the scale, write the registration and a picture with scale bars, report.

Perception finds the anatomy in every image, so only the scale is registered. Writes both files or neither.
"""

import json
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from haptigraph.analysis.registering.picture import BLACK, WHITE, draw_text
from haptigraph.analysis.registering.registering import check_files, images_of, spread_images
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import SourceConfig, load_config
from haptigraph.errors import BadInput
from haptigraph.files import write_files
from haptigraph.imaging import grey_of
from haptigraph.messages import Image
from haptigraph.perception.oct.scan_image import ScanScale, scan_image
from haptigraph.perception.oct.surfaces import find_surfaces
from haptigraph.recording.codec import encode_png
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.oct import ScanRegistration
from haptigraph.sources.naming import OCT_FILES

__all__ = ["is_bscan_source", "register_scans"]

MIN_SD_GREY = 4.0  # even the noise of a B-scan has a higher standard deviation
MIN_TISSUE_SHARE = 0.2  # of the columns; fewer with tissue deserve a look at the picture
BARS_MM = (1.0, 0.5, 0.2, 0.1, 0.05)
MARGIN_PX, MAX_HEIGHT_PX = 16, 900


def is_bscan_source(source: str) -> bool:
    """Return whether a source delivers B-scans."""
    return source.startswith("oct:") or Path(source).suffix.lower() in OCT_FILES


def register_scans(
    source: str,
    output: str | Path,
    settings: Sequence[str],
    picture: str | Path | None = None,
    *,
    force: bool = False,
    max_images: int = 40,
    progress: Progress | None = None,
) -> str:
    """Check a source of B-scans or volumes, and write the registration and its picture.

    Args:
        source: oct:PATH, or the path of a manufacturer's file.
        output: The TOML file to write.
        settings: "key=value" strings: scale, crop and other settings of the source.
        picture: The PNG file to write; beside the TOML file if None.
        force: Whether to overwrite existing files.
        max_images: How many B-scans to examine, evenly spread.
        progress: Called with the progress of reading.

    Returns:
        The report, several lines of text.

    Raises:
        BadInput: If scale or crop are not valid; then no file is written.
    """
    files = Path(output), Path(picture) if picture else Path(output).with_suffix(".png")
    check_files(files, source.removeprefix("oct:"), force=force)
    config = load_config(None, (f"source.uri={json.dumps(source)}", *settings))
    opened = open_source(config, VirtualClock())
    notes, text = opened.notes, opened.registration or ""
    with closing(images_of(opened)) as images:
        scans = [grey_of(image) for image in spread_images(images, source, max_images, progress)]
    registration = parse_registration(text, f"registration of {source}")
    axial_mm, lateral_mm = registration.image.axial_mm_per_px or 0.0, registration.image.mm_per_px
    slices, across = registration.image.slices, None
    if slices is not None and isinstance(registration, ScanRegistration):
        volumes = [registration.checked_volume(scan) for scan in scans]
        across = _Section(volumes[len(volumes) // 2][:, :, slices.columns // 2], axial_mm, slices.spacing_mm)
        scans = [np.ascontiguousarray(volume[:, slices.count // 2]) for volume in volumes]
    _check_contrast(scans, source)
    tissue_share, thickness_mm = _retina(scans, ScanScale(lateral_mm, axial_mm))
    middle = _Section(scans[len(scans) // 2], axial_mm, lateral_mm)
    write_files(files, (text.encode(), _picture(middle, across)))
    height, width = scans[0].shape
    scales = [
        ("axial", "axial_mm_per_px", axial_mm, height, "from top to bottom"),
        ("lateral", "lateral_mm_per_px", lateral_mm, width, "across"),
    ]
    crop, each = config.source.crop_px, "B-scans"
    cropped = "not cropped" if crop is None else f"cropped from ({crop[0]}, {crop[1]}) px of each image"
    if slices is not None:
        each, cropped = "volumes", f"{slices.count} B-scans each"
        scales.append(("slices", "slice_mm", slices.spacing_mm, slices.count, "from the first to the last"))
    return "\n".join(
        [
            *(f"note       {note}" for note in notes),
            f"{each:10} {width} x {height} px, {cropped}; {len(scans)} examined",
            *(
                f"{name:10} {scale:.6g} mm/px, {_scale_origin(config.source, key)}: "
                f"{length * scale:.2f} mm {direction}"
                for name, key, scale, length, direction in scales
            ),
            f"check      a pixel is {lateral_mm / axial_mm:.2f} times as wide as high",
            f"check      {_tissue_text(tissue_share, thickness_mm)}",
            f"written    {files[0]}\npicture    {files[1]}",
        ]
    )


class _Section(NamedTuple):
    """A section through the eye, and the size of its pixels."""

    grey: Image
    down_mm: float
    across_mm: float


def _scale_origin(config: SourceConfig, key: str) -> str:
    return "from the file" if getattr(config, key) is None else "as given"


def _check_contrast(scans: Sequence[Image], source: str) -> None:
    sd_grey = max(float(scan.std()) for scan in scans)
    if sd_grey < MIN_SD_GREY:
        raise BadInput(
            f"its B-scans are empty: grey levels vary by {sd_grey:.1f} (standard deviation); check the crop",
            source,
        )


def _retina(scans: Sequence[Image], scale: ScanScale) -> tuple[float, float]:
    """Return the share of columns with tissue, and the median distance from ILM to RPE [mm], or nan."""
    tissue_share, thickness_mm = [], []
    for scan in scans:
        prepared = scan_image(scan, scale)
        found = find_surfaces(prepared)
        tissue_share.append(found.ilm_visible.mean())
        thickness_mm.append((found.rpe_px - found.ilm_px)[found.rpe_visible] * prepared.scale.axial_mm)
    thickness = np.concatenate(thickness_mm)
    median_mm = float(np.median(thickness)) if len(thickness) else float("nan")
    return float(np.mean(tissue_share)), median_mm


def _tissue_text(tissue_share: float, thickness_mm: float) -> str:
    if not tissue_share >= MIN_TISSUE_SHARE or np.isnan(thickness_mm):
        return (
            f"only {tissue_share:.0%} of the columns show tissue: verify in the picture that it is a retina"
        )
    return (
        f"ILM and RPE are {thickness_mm:.2f} mm apart where both are visible "
        "(plausible: 0.15 to 0.45); otherwise the axial scale is wrong"
    )


def _picture(scan: _Section, across: _Section | None) -> bytes:
    """Return a PNG with scale bars: the B-scan as stored, in true proportions, a volume also across."""
    parts = [_with_bars(scan, "as stored"), _with_bars(_proportional(scan), "in true proportions")]
    if across is not None:
        parts.append(_with_bars(_proportional(across), "across the B-scans"))
    height = max(len(part) for part in parts)
    padded = [
        cv2.copyMakeBorder(part, 0, height - len(part), 0, MARGIN_PX, cv2.BORDER_CONSTANT) for part in parts
    ]
    return encode_png(np.hstack(padded))


def _proportional(section: _Section) -> _Section:
    """Return a section with square pixels."""
    height, width = section.grey.shape
    finest = min(section.down_mm, section.across_mm)
    size_px = round(width * section.across_mm / finest), round(height * section.down_mm / finest)
    scale = min(1.0, MAX_HEIGHT_PX / size_px[1], 2 * MAX_HEIGHT_PX / size_px[0])
    scaled_px = round(size_px[0] * scale), round(size_px[1] * scale)
    grey = np.asarray(cv2.resize(section.grey, scaled_px, interpolation=cv2.INTER_AREA), np.uint8)
    return _Section(grey, finest / scale, finest / scale)


def _with_bars(section: _Section, title: str) -> Image:
    scan, axial_mm, lateral_mm = section
    canvas = np.asarray(cv2.cvtColor(scan, cv2.COLOR_GRAY2BGR), np.uint8)
    height, width = scan.shape
    left, bottom = MARGIN_PX, height - MARGIN_PX
    across_mm, down_mm = _bar_mm(width * lateral_mm), _bar_mm(height * axial_mm)
    right, top = left + round(across_mm / lateral_mm), bottom - round(down_mm / axial_mm)
    for ink, thickness in ((BLACK, 5), (WHITE, 2)):
        cv2.line(canvas, (left, bottom), (right, bottom), ink, thickness)
        cv2.line(canvas, (left, bottom), (left, top), ink, thickness)
    draw_text(canvas, f"{across_mm:g} mm", (right + 6, bottom + 4))
    draw_text(canvas, f"{down_mm:g} mm", (left - 6, top - 8))
    draw_text(canvas, title, (left - 6, MARGIN_PX + 6))
    return canvas


def _bar_mm(length_mm: float) -> float:
    """Return the longest bar no longer than a third of an axis."""
    return next((bar_mm for bar_mm in BARS_MM if bar_mm <= length_mm / 3), BARS_MM[-1])
