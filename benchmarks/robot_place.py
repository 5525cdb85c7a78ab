"""Coverage of the intervals of `robot calibrate` and `sync-check` on simulated runs with known truth.

Each run is a robot that moves a needle in the section for 30 s, with tremor, from a base that is turned and
displaced at random. Its joints have noise (0.01 mm at the tip), half of the runs have stamps with 5 ms of
jitter, half a clock that drifts. The tips in the images have errors as a tracker's: 0.02 or 0.05 mm, lasting
0.3 s. Lags are up to 2.4 s. Besides, 5 to 12 points are touched with 0.1 mm of error. `--rendered` adds runs
whose images are drawn and tracked.
"""

import argparse
import math
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support" / "robots"))

from robot_runs import TARGET_MM, SimulatedRun, led_path, random_transform, simulated_run

from haptigraph.analysis.robot.lag import Motion, estimate_lag
from haptigraph.errors import BadInput
from haptigraph.robot.place.calibration import Calibration, calibrate_points, calibrate_section, pose_noise_mm
from haptigraph.robot.place.pivot import fit_pivot
from haptigraph.robot.place.rigid_fit import RigidFit
from haptigraph.robot.pose import Transform, at_times

Floats = NDArray[np.float64]
SEED = 2032
RUNS = 200
MAX_LAG_S, MAX_LEAD_S = 2.4, 0.3
TOUCH_SD_MM = 0.1
NORMAL_95 = 1.96
JACKKNIFE_95 = float(stats.t.ppf(0.975, 9))
IN_SECTION = [2, 3, 4]  # rotation about z, and the centroid's x and y
SCENARIO = """
[scenario]
description = "A robot moves the needle about, to be calibrated."
seed = {seed}

[readings]
stamps_late_ms = {late_ms}
{moves}
"""


class Table:
    """Whether truths lay inside intervals, and how wide these were."""

    def __init__(self) -> None:
        self.inside: defaultdict[str, list[bool]] = defaultdict(list)
        self.error: defaultdict[str, list[float]] = defaultdict(list)
        self.refused: defaultdict[str, int] = defaultdict(int)

    def add(self, name: str, errors: Floats, half_widths: Floats | float) -> None:
        """Add errors and the half widths of their intervals."""
        self.inside[name] += np.atleast_1d(np.abs(errors) <= half_widths).tolist()
        self.error[name] += np.atleast_1d(errors).tolist()

    def add_region(self, name: str, errors: Floats, covariance: Floats) -> None:
        """Add an error and whether it lies in its joint 95 % region."""
        distance = float(errors @ np.linalg.solve(covariance, errors))
        self.inside[name].append(distance <= stats.chi2.ppf(0.95, len(errors)))

    def print(self) -> None:
        """Print one line a quantity."""
        print(f"{'interval':44}{'n':>6}{'coverage':>10}{'RMS error':>12}")
        for name, inside in self.inside.items():
            errors = self.error[name]
            rms = f"{math.sqrt(np.mean(np.square(errors))):12.4f}" if errors else " " * 12
            print(f"{name:44}{len(inside):6}{100 * np.mean(inside):9.1f}%{rms}")
        for name, count in self.refused.items():
            print(f"refused: {name}: {count}")


def errors_of(fit: RigidFit, true: Transform) -> Floats:
    """Return the errors of rotation vector [rad] and centroid [mm], as in `fit.covariance`, (6,)."""
    turned = fit.eye_from_base.rotation @ true.rotation.T
    turn = (
        np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    )
    centroid = fit.centroid_mm - true.point_mm(fit.eye_from_base.inverse().point_mm(fit.centroid_mm))
    return np.concatenate((turn, centroid))


def add_tip(
    table: Table,
    name: str,
    calibration: Calibration,
    true: Transform,
    rng: np.random.Generator,
    noise_mm: float,
    axes: int,
) -> None:
    """Add the error of a new reading of the robot at the target."""
    base_mm = true.inverse().point_mm(TARGET_MM) + rng.normal(0, noise_mm, 3)
    error_mm = calibration.fit.eye_from_base.point_mm(base_mm) - TARGET_MM
    table.add(name, error_mm[:axes], NORMAL_95 * calibration.tip_sd_mm)


def add_run(table: Table, rng: np.random.Generator) -> None:
    """Simulate one run, and add what is estimated from it."""
    drift = float(rng.normal(0, 2e-4)) if rng.random() < 0.5 else 0.0
    jitter_s, tracker_sd_mm = 0.005 * (rng.random() < 0.5), float(rng.choice([0.02, 0.05]))
    run = simulated_run(
        rng,
        lag_s=float(rng.uniform(-MAX_LAG_S, MAX_LAG_S)),
        drift=drift,
        jitter_s=jitter_s,
        tracker_sd_mm=tracker_sd_mm,
    )
    try:
        lag = estimate_lag(Motion(run.image_s, run.image_mm, run.robot_s, run.robot_mm), "simulated run")
    except BadInput as refusal:
        table.refused[str(refusal)] += 1
        return
    true_s = run.lag_s + drift * (lag.middle_s - (run.image_s[-1] + run.image_s[1]) / 2)
    half_s = (lag.interval_s[1] - lag.interval_s[0]) / 2
    table.add("lag [ms]", np.array([1e3 * (lag.lag_s - true_s)]), 1e3 * half_s)
    half = (lag.drift_interval_s_per_s[1] - lag.drift_interval_s_per_s[0]) / 2
    table.add("drift [ms/s]", np.array([1e3 * (lag.drift_s_per_s - drift)]), 1e3 * half)
    try:
        lags_s = lag.lag_s + lag.drift_s_per_s * (run.image_s - lag.middle_s)
        add_section(table, rng, run, lags_s, tracker_sd_mm)
    except BadInput as refusal:
        table.refused[str(refusal)] += 1


def add_hand(table: Table, rng: np.random.Generator) -> None:
    """Let a hand lead the tip, whose motion is recorded with each image, and estimate its lead."""
    run = simulated_run(rng, lag_s=float(rng.uniform(-MAX_LEAD_S, 0.0)), robot_sd_mm=0.0)
    lag = estimate_lag(Motion(run.image_s, run.image_mm, *led_path(run)), "simulated run", mover="hand")
    half_s = (lag.interval_s[1] - lag.interval_s[0]) / 2
    table.add("hand's lead [ms]", np.array([1e3 * (lag.lag_s - run.lag_s)]), 1e3 * half_s)


def add_section(
    table: Table, rng: np.random.Generator, run: SimulatedRun, lags_s: Floats, tracker_sd_mm: float
) -> None:
    """Calibrate from the tips in the images, and fit the pivot."""
    at_s = run.image_s + lags_s
    base_mm = at_times(run.robot_s, run.robot_mm, at_s)
    calibration = calibrate_section(
        base_mm,
        run.image_mm,
        np.full(len(base_mm), tracker_sd_mm),
        pose_noise_mm(run.robot_s, run.robot_mm),
        TARGET_MM,
        "simulated run",
    )
    errors = errors_of(calibration.fit, run.eye_from_base)[IN_SECTION]
    covariance = calibration.fit.covariance[np.ix_(IN_SECTION, IN_SECTION)]
    table.add_region("place in the section, from a run (joint)", errors, covariance)
    at_target_mm = calibration.fit.eye_from_base.point_mm(run.eye_from_base.inverse().point_mm(TARGET_MM))
    table.add(
        "target in the base, from a run [mm]",
        (at_target_mm - TARGET_MM)[:2],
        NORMAL_95 * calibration.target_sd_mm,
    )
    add_tip(table, "tip at the target, from a run [mm]", calibration, run.eye_from_base, rng, 0.01, 2)
    pivot = fit_pivot(run.robot_mm[::6], run.robot_axes[::6], "simulated run")
    table.add("pivot [mm]", pivot.at_mm - run.rcm_mm, JACKKNIFE_95 * pivot.sd_mm)


def add_touch(table: Table, rng: np.random.Generator, *, planar: bool) -> None:
    """Touch points and calibrate."""
    true, count = random_transform(rng), int(rng.integers(5, 13))
    eye_mm = rng.uniform(-10, 10, (count, 3)) * (1, 1, not planar)
    base_mm = true.inverse().point_mm(eye_mm) + rng.normal(0, TOUCH_SD_MM, (count, 3))
    where = "in a plane" if planar else "in space"
    try:
        calibration = calibrate_points(base_mm, eye_mm, TOUCH_SD_MM, TARGET_MM, f"touched points {where}")
    except BadInput as refusal:
        table.refused[str(refusal).split(":")[0]] += 1
        return
    errors = errors_of(calibration.fit, true)
    table.add_region(f"place, from points {where} (joint)", errors, calibration.fit.covariance)
    add_tip(table, f"tip at the target, from points {where} [mm]", calibration, true, rng, TOUCH_SD_MM, 3)


def add_rendered(table: Table, rng: np.random.Generator, folder: Path, number: int) -> None:
    """Draw, track and record a run of 12 s, and estimate its lag."""
    from haptigraph.analysis.robot.calibrating import from_run
    from haptigraph.analysis.robot.recorded import recorded_motion
    from haptigraph.assemble import build
    from haptigraph.config import load_config
    from haptigraph.recording.reader import RunReader
    from haptigraph.robot.setup import parse_setup

    late_ms = float(rng.uniform(-200, 200))
    depths, angles = rng.uniform(5, 20, 9), rng.uniform(-12, 12, 9)
    moves = "".join(
        f"\n[[move]]\nduration_s = 1.5\ndepth_mm = {depth:.2f}\ntheta_deg = {angle:.2f}\n"
        for depth, angle in zip(depths, angles, strict=True)
    )
    scenario, recording = folder / f"{number}.toml", folder / f"{number}.mcap"
    scenario.write_text(SCENARIO.format(seed=int(rng.integers(1000)), late_ms=late_ms, moves=moves))
    settings = (f"source.uri=phantom:{scenario}", f"recording.path={recording}", "run.realtime=false")
    build(load_config(None, settings)).run()
    reader = RunReader(recording)
    lag = estimate_lag(recorded_motion(reader).motion, str(recording))
    half_s = (lag.interval_s[1] - lag.interval_s[0]) / 2
    table.add("lag, drawn and tracked [ms]", np.array([1e3 * lag.lag_s - late_ms]), 1e3 * half_s)
    calibration, _, _ = from_run(recording, "+z")
    setup = parse_setup(reader.info.robot_setup, "simulated robot")
    if setup.eye is not None:
        true = setup.eye.robot_from_eye.inverse()
        add_tip(table, "tip at the target, drawn and tracked [mm]", calibration, true, rng, 0.01, 2)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--rendered", type=int, default=0, help="Number of runs that are drawn and tracked.")
    arguments = parser.parse_args()
    table, rng = Table(), np.random.default_rng(arguments.seed)
    hands = np.random.default_rng((arguments.seed, 1))
    for _ in range(RUNS):
        add_run(table, rng)
        add_hand(table, hands)
        add_touch(table, rng, planar=True)
        add_touch(table, rng, planar=False)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arguments.rendered):
            add_rendered(table, rng, Path(folder), number)
    table.print()


if __name__ == "__main__":
    main()
