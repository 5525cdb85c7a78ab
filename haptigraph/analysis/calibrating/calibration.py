"""Fit a lens to views of the board, with its uncertainty; refuse what does not determine it.

OpenCV's calibration (Z. Zhang, "A flexible new technique for camera calibration", TPAMI 22, 2000) gives the
parameters and their standard deviations. How far corrected points may be off is estimated by a jackknife over
groups of views, because the errors of the parameters are strongly correlated.
"""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.calibrating.board import View
from haptigraph.errors import BadInput
from haptigraph.imaging import Floats
from haptigraph.lens import Lens

__all__ = ["MIN_COVERAGE", "Calibration", "calibrate", "coverage", "missing_parts"]

MIN_VIEWS = 8
CELLS = 8, 5
"""Columns and rows into which the image is divided for its coverage."""
MIN_COVERAGE = 0.8
TILTED_VIEWS, MIN_TILT_DEG = 4, 10.0
MAX_RMS_PX = 0.6
MAX_SD_PX = 0.5
MAX_FOCAL_SD = 0.02
OUTLIER = 3.0
"""A view whose residual is this many times the median is left out: it was blurred by motion."""
GROUPS = 6
GRID_PX = 40.0
SIDES = ("left", "middle", "right"), ("upper", "middle", "lower")


class Calibration(Struct, frozen=True):
    """A lens as calibrated."""

    lens: Lens
    sd: Lens
    """Standard deviations of its parameters, from the residuals."""
    rms_px: float
    views: int
    coverage: float
    """Share of the image's parts in which corners were found."""


def calibrate(views: Sequence[View], size_px: tuple[int, int]) -> Calibration:
    """Fit a lens to views of the board.

    Args:
        views: Different views, all in images of one size.
        size_px: (width, height) of the images.

    Raises:
        BadInput: If they do not determine the lens well enough.
    """
    if len(views) < MIN_VIEWS:
        raise BadInput(
            f"the sheet was found in {len(views)} different positions, at least {MIN_VIEWS} are needed; show "
            "it nearer and farther, tilted each way, and in every part of the image"
        )
    covered = coverage(views, size_px)
    if covered < MIN_COVERAGE:
        raise BadInput(
            f"the sheet covers {covered:.0%} of the image, at least {MIN_COVERAGE:.0%} is needed; show it "
            f"also {missing_parts(views, size_px)}"
        )
    fit = _fit(views, size_px)
    errors = fit.view_errors_px
    kept = [view for view, error in zip(views, errors, strict=True) if error < OUTLIER * np.median(errors)]
    if len(kept) < len(views):
        fit = _fit(kept, size_px)
    _check_tilts(fit.tilts_deg)
    sd_px = _correction_sd_px(kept, fit.lens, size_px)
    found = Calibration(
        replace(fit.lens, sd_px=sd_px), fit.sd, fit.rms_px, len(kept), coverage(kept, size_px)
    )
    _check(found, size_px)
    return found


def coverage(views: Sequence[View], size_px: tuple[int, int]) -> float:
    """Return the share of the image's parts in which corners were found."""
    return float(np.mean(_parts(views, size_px)))


def missing_parts(views: Sequence[View], size_px: tuple[int, int]) -> str:
    """Describe where in the image no corners were found: "at the upper left and the lower right"."""
    names = []
    for row, part in enumerate(_thirds(_parts(views, size_px))):
        names += [
            f"{SIDES[1][row]} {SIDES[0][column]}".replace("middle middle", "middle")
            for column in range(3)
            if not part[column]
        ]
    *others, last = names or [""]
    return f"at the {', '.join(others)} and {last}" if others else f"at the {last}"


class _Fit(Struct, frozen=True, eq=False):
    lens: Lens
    sd: Lens
    rms_px: float
    view_errors_px: Floats
    tilts_deg: Floats
    """Between sheet and image plane, by view."""


def _fit(views: Sequence[View], size_px: tuple[int, int]) -> _Fit:
    on_board = [np.pad(view.board_points, ((0, 0), (0, 1))).astype(np.float32) for view in views]
    points = [view.points_px.astype(np.float32)[:, None] for view in views]
    start: Any = np.eye(3), np.zeros(5)
    rms, camera, distortion, rotations, _, sd, _, errors = cv2.calibrateCameraExtended(
        on_board, points, size_px, *start
    )
    facing = [cv2.Rodrigues(rotation)[0][2, 2] for rotation in rotations]
    values = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2], *distortion.ravel()[:5]
    return _Fit(
        _lens(values),
        _lens(sd.ravel()[:9]),
        float(rms),
        np.array(errors, np.float64).ravel(),
        np.degrees(np.arccos(np.clip(facing, -1, 1))),
    )


def _lens(values: Any) -> Lens:
    across, down, x, y, k1, k2, p1, p2, k3 = (float(value) for value in values)
    return Lens((across, down), (x, y), (k1, k2, p1, p2, k3))


def _correction_sd_px(views: Sequence[View], lens: Lens, size_px: tuple[int, int]) -> float:
    """Return the standard deviation of corrected points at the worst covered place, by a jackknife.

    What a registration compensates, shift, scale and rotation, is fitted and left out.
    """
    places = _covered_places(views, size_px)
    reference = _corrected(lens, places)
    others = []
    for group in range(GROUPS):
        rest = [view for number, view in enumerate(views) if number % GROUPS != group]
        others.append(_aligned(_corrected(_fit(rest, size_px).lens, places), reference))
    spread = np.abs(np.array(others) - np.mean(others, axis=0))
    return float(np.sqrt((GROUPS - 1) / GROUPS * (spread**2).sum(axis=0)).max())


def _corrected(lens: Lens, places: Sequence[tuple[float, float]]) -> Any:
    """Return undistorted points as complex numbers, (n,)."""
    return np.array([complex(*lens.undistorted(place)) for place in places])


def _aligned(points: Any, reference: Any) -> Any:
    """Return points after the similarity transform that brings them nearest to others."""
    rows = np.stack([points, np.ones(len(points))], axis=1)
    return rows @ np.linalg.lstsq(rows, reference, rcond=None)[0]


def _covered_places(views: Sequence[View], size_px: tuple[int, int]) -> list[tuple[float, float]]:
    parts = _parts(views, size_px)
    return [
        (float(x), float(y))
        for y in np.arange(GRID_PX / 2, size_px[1], GRID_PX)
        for x in np.arange(GRID_PX / 2, size_px[0], GRID_PX)
        if parts[int(y / size_px[1] * CELLS[1]), int(x / size_px[0] * CELLS[0])]
    ]


def _parts(views: Sequence[View], size_px: tuple[int, int]) -> Any:
    """Return in which parts of the image corners were found, (rows, columns)."""
    found = np.zeros(CELLS[::-1], np.bool_)
    for view in views:
        part = np.floor(view.points_px / size_px * CELLS).astype(int)
        inside = ((part >= 0) & (part < CELLS)).all(axis=1)
        found[part[inside, 1], part[inside, 0]] = True
    return found


def _thirds(parts: Any) -> list[list[bool]]:
    """Return which thirds of the image, by rows and columns, are covered throughout."""
    return [
        [bool(block.all()) for block in np.array_split(rows, 3, axis=1)]
        for rows in np.array_split(parts, 3, axis=0)
    ]


def _check_tilts(tilts_deg: Floats) -> None:
    """Refuse level views, which do not determine the focal length, whatever its standard deviation."""
    tilt_deg = float(np.sort(tilts_deg)[-TILTED_VIEWS])
    if tilt_deg < MIN_TILT_DEG:
        raise BadInput(
            f"fewer than {TILTED_VIEWS} views have a sheet that is tilted by {MIN_TILT_DEG:g} degrees; show "
            "it tilted by 20 to 45 degrees in every direction, near the camera"
        )


def _check(found: Calibration, size_px: tuple[int, int]) -> None:
    lens, more = found.lens, "calibrate again with the sheet flat, sharp and evenly lit"
    if found.rms_px > MAX_RMS_PX:
        raise BadInput(
            f"the corners are off by {found.rms_px:.2f} px (RMS), at most {MAX_RMS_PX:g} px is accepted; "
            + more
        )
    focal_sd = max(found.sd.focal_px) / lens.ideal_focal_px
    if focal_sd > MAX_FOCAL_SD or not math.isfinite(focal_sd):
        raise BadInput(
            f"the focal length is uncertain by {focal_sd:.1%}, at most {MAX_FOCAL_SD:.0%} is accepted; show "
            "the sheet tilted by 20 to 45 degrees in every direction, near the camera"
        )
    if not lens.is_invertible(*size_px):
        raise BadInput(f"the fitted distortion maps two points to one place in the image; {more}")
    if lens.sd_px is None or not lens.sd_px <= MAX_SD_PX:
        raise BadInput(
            f"corrected points are uncertain by {lens.sd_px:.2f} px, at most {MAX_SD_PX:g} px is accepted; "
            "use more views, near the image's borders as well"
        )
