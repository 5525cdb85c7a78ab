import math

import numpy as np
import pytest
from helpers import call, refuse
from robot_runs import random_transform

from haptigraph.recording.reader import RunReader
from haptigraph.robot.setup import load_setup, parse_setup

NAMES = {
    "trocar": (-7.0, 10.0, 0.0),
    "target": (1.0, -11.9, 0.0),
    "left": (-11.0, -4.0, 0.0),
    "right": (11.0, -4.0, 0.5),
    "below": (0.0, -9.0, 3.0),
}


def touched_csv(path, base_mm):
    rows = [
        ",".join([name, *map(str, eye), *(f"{one:.6f}" for one in base)])
        for (name, eye), base in zip(NAMES.items(), base_mm, strict=True)
    ]
    header = "name,eye_x_mm,eye_y_mm,eye_z_mm,base_x_mm,base_y_mm,base_z_mm"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.fixture
def true():
    return random_transform(np.random.default_rng(5))


@pytest.fixture
def points(tmp_path, true):
    eye_mm = np.array(list(NAMES.values()))
    return touched_csv(tmp_path / "touched.csv", true.inverse().point_mm(eye_mm))


def test_touched_points_give_a_setup(points, true, tmp_path):
    output = tmp_path / "robot.toml"
    result = call("robot", "calibrate", "-o", output, "--points", points)
    assert result.exit_code == 0 and "left out" in result.output
    setup = load_setup(output)
    for name, eye_mm in NAMES.items():
        found = setup.eye.robot_from_eye.point_mm(eye_mm)
        assert math.dist(found, true.inverse().point_mm(eye_mm)) < 1e-4, name
    assert math.dist(setup.rcm.at_mm, true.inverse().point_mm(NAMES["trocar"])) < 1e-4
    assert setup.eye.tip_sd_mm >= 0.1


def test_an_existing_file_is_kept_unless_forced_and_its_limits_always(points, tmp_path):
    output = tmp_path / "robot.toml"
    earlier = "[rcm]\nat_mm = [1.0, 2.0, 3.0]\n[limits]\nspeed_mm_s = 2.5\n"
    output.write_text(earlier)
    assert "exists already" in refuse("robot", "calibrate", "-o", output, "--points", points)
    assert output.read_text() == earlier
    assert call("robot", "calibrate", "-o", output, "--points", points, "--force").exit_code == 0
    assert load_setup(output).limits.speed_mm_s == 2.5


@pytest.mark.parametrize(
    "old, new, problem",
    [
        ("base_z_mm", "z", "base_x_mm is missing"),
        ("eye_z_mm", "z", "eye_z_mm is missing"),
        ("trocar,-7.0", "trocar,here", "line 2"),
        ("trocar,-7.0", "trocar,nan", "not finite"),
        ("trocar", "port", "no point is called 'trocar'"),
    ],
)
def test_what_is_wrong_with_a_file_is_named_and_nothing_written(points, tmp_path, old, new, problem):
    points.write_text(points.read_text().replace(old, new))
    assert problem in refuse("robot", "calibrate", "-o", tmp_path / "robot.toml", "--points", points)
    assert not (tmp_path / "robot.toml").exists()


def test_a_recorded_run_gives_eye_pivot_and_lag(late_run, tmp_path):
    output = tmp_path / "robot.toml"
    result = call("robot", "calibrate", "-o", output, "--run", late_run)
    assert result.exit_code == 0 and "robot.latency_ms=1" in result.output
    assert "assumed: the motion lay in the section" in output.read_text()
    found, true = load_setup(output), parse_setup(RunReader(late_run).info.robot_setup, "simulated robot")
    target_mm = (0.0, -11.9, 0.0)
    apart_mm = math.dist(
        found.eye.robot_from_eye.point_mm(target_mm), true.eye.robot_from_eye.point_mm(target_mm)
    )
    assert apart_mm < 0.05 and found.eye.tip_sd_mm < 0.1
    assert math.dist(found.rcm.at_mm, true.rcm.at_mm) < 5 * found.rcm.sd_mm < 0.3


def test_a_run_or_points_are_needed_and_not_both(points, late_run, tmp_path):
    output = tmp_path / "robot.toml"
    assert "one of --run RUN, --points FILE" in refuse("robot", "calibrate", "-o", output)
    assert "one of" in refuse("robot", "calibrate", "-o", output, "--points", points, "--run", late_run)
    assert "go with --points" in refuse("robot", "calibrate", "-o", output, "--run", late_run, "--robot", "x")


def test_a_wrong_shaft_axis_is_refused(late_run, tmp_path):
    given = ("robot", "calibrate", "-o", tmp_path / "robot.toml", "--run", late_run, "--shaft-axis", "+x")
    assert "do not meet" in refuse(*given) or "turns by" in refuse(*given)
