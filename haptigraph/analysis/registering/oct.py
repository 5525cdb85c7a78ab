"""Register B-scans: check scale and crop, draw them to look at, and write them down.

Everything but the scale is found anew in every image, so nothing is searched for here. A source goes in; a
TOML, a picture with scale bars and some lines of text come out. Either both files are written or neither.
"""

import json
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from haptigraph.analysis.registering.registering import check_files, images_of, spread_images, write_files
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import SourceConfig, load_config
from haptigraph.errors import BadInput
from haptigraph.imaging import grey_of
from haptigraph.messages import Image
from haptigraph.perception.oct.surfaces import find_surfaces
from haptigraph.registration.oct import parse_registered
from haptigraph.sources.naming import OCT_FILES

__all__ = ["brings_scans", "register_scans"]

MIN_SD_GREY = 4.0  # even the noise of a B-scan has more
LEAST_SEEN = 0.2  # share of the columns: with tissue in fewer, someone should look why
BARS_MM = (1.0, 0.5, 0.2, 0.1, 0.05)
MARGIN_PX, TALLEST_PX = 16, 900
INK, SHADE = (255, 255, 255), (0, 0, 0)


def brings_scans(source: str) -> bool:
    """Tell whether a source is one of B-scans."""
    return source.startswith("oct:") or Path(source).suffix.lower() in OCT_FILES


def register_scans(
    source: str,
    output: str | Path,
    settings: Sequence[str],
    picture: str | Path | None = None,
    *,
    force: bool = False,
    most: int = 40,
) -> str:
    """Check a source of B-scans, and write the registration and its picture.

    Args:
        source: oct:PATH, or the path of a maker's file.
        output: The TOML to write.
        settings: "key=value" strings: scale, crop and what else the source needs.
        picture: The PNG to write; beside the TOML if None.
        force: Whether existing files may be overwritten.
        most: How many B-scans to look at, spread out.

    Returns:
        The report, some lines of text.

    Raises:
        BadInput: If scale or crop make no sense; nothing is written then.
    """
    files = Path(output), Path(picture) if picture else Path(output).with_suffix(".png")
    check_files(files, source.removeprefix("oct:"), force=force)
    config = load_config(None, (f"source.uri={json.dumps(source)}", *settings))
    opened = open_source(config, VirtualClock())
    notes, text = opened.notes, opened.registration or ""
    with closing(images_of(opened)) as images:
        scans = [grey_of(image) for image in spread_images(images, source, most, None)]
    registration = parse_registered(text, f"registration of {source}")
    _check_contrast(scans, source)
    axial_mm, lateral_mm = registration.image.axial_mm_per_px or 0.0, registration.image.mm_per_px
    seen, thick_mm = _retina(scans, axial_mm)
    write_files(files, (text.encode(), _picture(scans[len(scans) // 2], axial_mm, lateral_mm)))
    crop, size_px = config.source.crop_px, (registration.width_px, registration.height_px)
    cut = "no crop" if crop is None else f"cut from ({crop[0]}, {crop[1]}) px of each image"
    scales = (
        ("axial", axial_mm, size_px[1], "from top to bottom"),
        ("lateral", lateral_mm, size_px[0], "across"),
    )
    return "\n".join(
        [
            *(f"note       {note}" for note in notes),
            f"B-scans    {size_px[0]} x {size_px[1]} px, {cut}; {len(scans)} looked at",
            *(
                f"{name:10} {scale:.6g} mm/px, {_whose(config.source, name)}: {length * scale:.2f} mm {way}"
                for name, scale, length, way in scales
            ),
            f"check      a pixel is {lateral_mm / axial_mm:.2f} times as wide as high",
            f"check      {_told(seen, thick_mm)}",
            f"written    {files[0]}\npicture    {files[1]}",
        ]
    )


def _whose(asked: SourceConfig, name: str) -> str:
    return "as the file says" if getattr(asked, f"{name}_mm_per_px") is None else "as given"


def _check_contrast(scans: Sequence[Image], source: str) -> None:
    sd_grey = max(float(scan.std()) for scan in scans)
    if sd_grey < MIN_SD_GREY:
        raise BadInput(
            f"there is nothing in its B-scans: grey varies by {sd_grey:.1f} only; is the crop right?",
            source,
        )


def _retina(scans: Sequence[Image], axial_mm_per_px: float) -> tuple[float, float]:
    """Return the share of columns with tissue, and the median way from ILM to RPE [mm], nan if not seen."""
    seen, thick_mm = [], []
    for scan in scans:
        found = find_surfaces(scan, axial_mm_per_px)
        seen.append(found.ilm_seen.mean())
        thick_mm.append((found.rpe_px - found.ilm_px)[found.rpe_seen] * axial_mm_per_px)
    thick = np.concatenate(thick_mm)
    return float(np.mean(seen)), float(np.median(thick)) if len(thick) else float("nan")


def _told(seen: float, thick_mm: float) -> str:
    if not seen >= LEAST_SEEN or np.isnan(thick_mm):
        return f"tissue is seen in {seen:.0%} of the columns only: look at the picture, is this a retina?"
    return (
        f"ILM and RPE, as far as they are seen, lie {thick_mm:.2f} mm apart "
        "(plausible: 0.15 to 0.45); if not, the axial scale is wrong"
    )


def _picture(scan: Image, axial_mm: float, lateral_mm: float) -> bytes:
    """Return a PNG: the B-scan as stored, and beside it in true proportions; a scale bar for each axis."""
    height, width = scan.shape
    fine = min(axial_mm, lateral_mm)
    size_px = round(width * lateral_mm / fine), round(height * axial_mm / fine)
    shrink = min(1.0, TALLEST_PX / size_px[1], 2 * TALLEST_PX / size_px[0])
    shown_px = round(size_px[0] * shrink), round(size_px[1] * shrink)
    true = np.asarray(cv2.resize(scan, shown_px, interpolation=cv2.INTER_AREA), np.uint8)
    parts = [
        _with_bars(scan, axial_mm, lateral_mm, "as stored"),
        _with_bars(true, fine / shrink, fine / shrink, "in true proportions"),
    ]
    tallest = max(len(part) for part in parts)
    filled = [
        cv2.copyMakeBorder(part, 0, tallest - len(part), 0, MARGIN_PX, cv2.BORDER_CONSTANT) for part in parts
    ]
    done, png = cv2.imencode(".png", np.hstack(filled))
    if not done:
        raise RuntimeError("OpenCV could not encode a PNG")
    return png.tobytes()


def _with_bars(scan: Image, axial_mm: float, lateral_mm: float, title: str) -> Image:
    canvas = np.asarray(cv2.cvtColor(scan, cv2.COLOR_GRAY2BGR), np.uint8)
    height, width = scan.shape
    left, bottom = MARGIN_PX, height - MARGIN_PX
    across_mm, down_mm = _bar_mm(width * lateral_mm), _bar_mm(height * axial_mm)
    right, top = left + round(across_mm / lateral_mm), bottom - round(down_mm / axial_mm)
    for ink, thick in ((SHADE, 5), (INK, 2)):
        cv2.line(canvas, (left, bottom), (right, bottom), ink, thick)
        cv2.line(canvas, (left, bottom), (left, top), ink, thick)
    _say(canvas, f"{across_mm:g} mm", (right + 6, bottom + 4))
    _say(canvas, f"{down_mm:g} mm", (left - 6, top - 8))
    _say(canvas, title, (left - 6, MARGIN_PX + 6))
    return canvas


def _bar_mm(length_mm: float) -> float:
    """Return the longest bar that is no longer than a third of an axis."""
    return next((bar_mm for bar_mm in BARS_MM if bar_mm <= length_mm / 3), BARS_MM[-1])


def _say(canvas: Image, text: str, at_px: tuple[int, int]) -> None:
    for ink, thick in ((SHADE, 3), (INK, 1)):
        cv2.putText(canvas, text, at_px, cv2.FONT_HERSHEY_SIMPLEX, 0.5, ink, thick, cv2.LINE_AA)
