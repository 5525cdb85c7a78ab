"""Calibrate a robot from files: touched points, or recorded runs -> robot.toml and a report."""

import csv
import math
from pathlib import Path

import numpy as np

from haptigraph.analysis.robot.lag import Lag, estimate_lag
from haptigraph.analysis.robot.recorded import recorded_motion
from haptigraph.errors import BadInput
from haptigraph.files import write_files
from haptigraph.recording.reader import RunReader
from haptigraph.robot.place.calibration import (
    Calibration,
    calibrate_points,
    calibrate_section,
    leave_one_out_mm,
    pose_noise_mm,
    rcm_of,
    setup_text,
)
from haptigraph.robot.place.pivot import Pivot, fit_pivot
from haptigraph.robot.pose import Floats, rotated
from haptigraph.robot.setup import (
    EyePlace,
    RcmPlace,
    RobotSetup,
    ShaftAxis,
    direction_of_axis,
    load_setup,
    parse_setup,
)

__all__ = ["TouchedPoints", "from_points", "from_run", "pivot_of", "read_points", "write_setup"]

EYE_COLUMNS = ("eye_x_mm", "eye_y_mm", "eye_z_mm")
BASE_COLUMNS = ("base_x_mm", "base_y_mm", "base_z_mm")
MAX_POSES = 1500  # of a run, for the pivot: more are no more independent
MAX_LEFT_OUT = 200
ALIGNED_S = 0.01
TROCAR = "trocar"


class TouchedPoints:
    """Points of the eye frame, and where the robot's tip was when it touched them.

    Args:
        names: One a point.
        eye_mm: (n, 3).
        base_mm: (n, 3); None: not touched yet.
        file: Where they come from.
    """

    def __init__(self, names: list[str], eye_mm: Floats, base_mm: Floats | None, file: str) -> None:
        self.names, self.eye_mm, self.base_mm, self.file = names, eye_mm, base_mm, file


def read_points(path: str | Path) -> TouchedPoints:
    """Read a CSV file with a header: name, eye_x_mm, eye_y_mm, eye_z_mm, and base_x_mm, base_y_mm, base_z_mm.

    The last three are left out of a file whose points are to be touched.

    Raises:
        BadInput: If it cannot be read, a column is missing, or a cell is not a number.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, strict=True))
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise BadInput(f"not a CSV file ({error})", path) from None
    if not rows:
        raise BadInput("has no points", path)
    columns = {name for name in rows[0] if name}
    if missing := [name for name in ("name", *EYE_COLUMNS) if name not in columns]:
        raise BadInput(f"column {missing[0]} is missing", path)
    is_touched = columns >= {*BASE_COLUMNS}
    return TouchedPoints(
        [row["name"] for row in rows],
        _numbers(rows, EYE_COLUMNS, path),
        _numbers(rows, BASE_COLUMNS, path) if is_touched else None,
        str(path),
    )


def from_points(
    points: TouchedPoints, sd_mm: float, pivot: Pivot | None
) -> tuple[Calibration, RcmPlace, list[str]]:
    """Calibrate from touched points.

    Args:
        points: With the robot's positions.
        sd_mm: Standard deviation of one touch, per axis.
        pivot: The remote centre of motion; None: the point called "trocar".

    Returns:
        The calibration, the [rcm] table, and the report.

    Raises:
        BadInput: If they do not determine it.
    """
    if points.base_mm is None:
        raise BadInput(
            f"column {BASE_COLUMNS[0]} is missing; or give --robot to touch the points", points.file
        )
    target_mm = _named(points, "target", points.eye_mm)
    if target_mm is None:
        target_mm = points.eye_mm.mean(axis=0)
    calibration = calibrate_points(points.base_mm, points.eye_mm, sd_mm, target_mm, points.file)
    touched = _named(points, TROCAR, points.base_mm)
    if pivot is None and touched is None:
        raise BadInput(
            f"no point is called {TROCAR!r}, so the pivot is not known; add it, or --pivot", points.file
        )
    if pivot is not None:
        rcm = rcm_of(pivot)
    else:
        x, y, z = np.asarray(touched).tolist()
        rcm = RcmPlace((x, y, z), sd_mm)
    lines = [
        f"{name:15} residual {1e3 * np.linalg.norm(residual):6.0f} µm{'' if used else '   left out'}"
        for name, residual, used in zip(
            points.names, calibration.fit.residual_mm, calibration.fit.used, strict=True
        )
    ]
    return calibration, rcm, [*lines, *_lines(calibration, points.base_mm, points.eye_mm)]


def from_run(path: str | Path, shaft_axis: ShaftAxis) -> tuple[Calibration, RcmPlace, list[str]]:
    """Calibrate from a recorded run in which the tracker sees the needle that the robot moves in the section.

    Returns:
        The calibration, the [rcm] table, and the report.

    Raises:
        BadInput: If the run does not determine it.
    """
    reader = RunReader(path)
    recorded = recorded_motion(reader)
    lag = estimate_lag(recorded.motion, str(path))
    tips_mm, inside = recorded.robot_at_images(lag)
    # A tracker's is along the shaft, and much smaller across it: on average over the axes, half the variance.
    image_mm, image_sd_mm = recorded.motion.image_mm[inside], recorded.image_sd_mm[inside] / math.sqrt(2)
    noise_mm = pose_noise_mm(recorded.motion.robot_s, recorded.motion.robot_mm)
    calibration = calibrate_section(
        tips_mm[inside], image_mm, image_sd_mm, noise_mm, recorded.target_mm, str(path)
    )
    pivot = pivot_of(path, shaft_axis)
    eye_mm = np.column_stack((image_mm, np.zeros(len(image_mm))))
    lines = _lines(calibration, tips_mm[inside], eye_mm)
    return calibration, rcm_of(pivot), [*lines, *_pivot_lines(pivot), *_lag_lines(lag)]


def pivot_of(path: str | Path, shaft_axis: ShaftAxis) -> Pivot:
    """Fit the remote centre of motion from a recorded run.

    Raises:
        BadInput: If the run does not determine it.
    """
    poses = [one for capture, _ in RunReader(path).records(images=()) for one in capture.robot]
    if not poses:
        raise BadInput("has no robot measurements; record the run with --robot", path)
    poses = poses[:: math.ceil(len(poses) / MAX_POSES)]
    tips_mm = np.array([one.position_mm for one in poses])
    shaft = direction_of_axis(shaft_axis)
    axes = np.array([rotated(one.quaternion, shaft) for one in poses])
    return fit_pivot(tips_mm, axes, str(path))


def write_setup(
    output: str | Path,
    eye: EyePlace,
    rcm: RcmPlace,
    shaft_axis: ShaftAxis,
    source: str,
    notes: tuple[str, ...] = (),
    *,
    force: bool = False,
) -> None:
    """Write robot.toml in one go; the limits of a file that is overwritten are kept.

    Raises:
        BadInput: If it exists and is not to be overwritten, is not valid, or cannot be written.
    """
    path = Path(output)
    kept: RobotSetup | None = None
    if path.exists():
        if not force:
            raise BadInput("exists already; --force overwrites it and keeps its limits", path)
        kept = load_setup(path)
    if not path.parent.is_dir():
        raise BadInput("its folder does not exist; create it first", path)
    title = f"Robot calibrated by haptigraph from {source}. Research software, not a medical device."
    text = setup_text(eye, rcm, kept, shaft_axis, title, notes)
    parse_setup(text, str(path))
    write_files((path,), (text.encode(),))


def _lines(calibration: Calibration, base_mm: Floats, eye_mm: Floats) -> list[str]:
    fit = calibration.fit
    used = int(fit.used.sum())
    lines = [
        f"points          {used} of {len(fit.used)} used, residual {fit.rms_mm:.3f} mm RMS",
        f"eye             standard deviations: turn {', '.join(f'{one:.2f}' for one in fit.turn_sd_deg())} ° "
        f"about x, y, z; the target {calibration.target_sd_mm:.3f} mm",
        f"tip             standard deviation at the target {calibration.tip_sd_mm:.3f} mm per axis, with "
        f"{calibration.pose_sd_mm:.3f} mm of a pose of the robot",
    ]
    if used <= MAX_LEFT_OUT:
        left_out = leave_one_out_mm(base_mm, eye_mm, fit)
        lines.append(
            f"left out        each point is {math.sqrt(float((left_out**2).mean())):.3f} mm RMS from the fit "
            f"of all others, at most {left_out.max():.3f} mm"
        )
    return lines + [f"note            {note}" for note in calibration.notes]


def _pivot_lines(pivot: Pivot) -> list[str]:
    return [
        f"pivot           standard deviation {pivot.sd_mm:.3f} mm per axis; shafts pass it at "
        f"{pivot.rms_mm:.3f} mm RMS, turned by {pivot.turn_deg:.1f}°"
    ]


def _lag_lines(lag: Lag) -> list[str]:
    low, high = lag.interval_s
    lines = [
        f"lag             {1e3 * lag.lag_s:+.1f} ms ({1e3 * low:+.1f} to {1e3 * high:+.1f} ms), allowed for"
    ]
    if abs(lag.lag_s) > ALIGNED_S:
        lines.append(f"note            in runs, set robot.latency_ms={1e3 * lag.lag_s:.1f}")
    return lines


def _named(points: TouchedPoints, name: str, values: Floats) -> Floats | None:
    return values[points.names.index(name)] if name in points.names else None


def _numbers(rows: list[dict[str, str]], columns: tuple[str, ...], path: str | Path) -> Floats:
    values = np.empty((len(rows), len(columns)))
    for number, row in enumerate(rows):
        for at, column in enumerate(columns):
            try:
                values[number, at] = float(row[column])
            except (TypeError, ValueError):
                found = f"{column}: expected a number, found {row[column]!r}"
                raise BadInput(found, path, f"line {number + 2}") from None
    if not np.isfinite(values).all():
        raise BadInput("a coordinate is not finite", path)
    return values
