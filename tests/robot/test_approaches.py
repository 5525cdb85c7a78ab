"""A simulated arm with joint errors and latency follows hands, and is held after faults; on a virtual clock."""

import numpy as np
import pytest
from robot_approaches import (
    FAULTS,
    LIMIT_MS,
    START_MS,
    TOLERANCE_MM,
    Held,
    Run,
    approach,
    report_trials,
    trial,
)

from haptigraph.robot.gate import HOLDS, LATCHED


def judge(rows: np.ndarray, depth_mm: float) -> None:
    commanded_mm, true_mm, depths_mm = rows.T
    assert commanded_mm.max() <= TOLERANCE_MM
    assert true_mm[depths_mm >= 0].max() <= TOLERANCE_MM
    assert depth_mm > 8.0
    assert len(rows) > 1000


def judge_trial(held: Held) -> None:
    assert held.last_move_ms <= LIMIT_MS, held
    assert held.restarts == 0, held
    assert held.resumes, held


@pytest.mark.parametrize("seed", [1])
def test_the_shaft_stays_at_the_rcm_during_an_approach(seed):
    judge(*approach(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 300))
def test_the_shaft_stays_at_the_rcm_during_200_approaches(seed):
    judge(*approach(seed))


@pytest.mark.parametrize("seed", range(len(FAULTS)), ids=FAULTS)
def test_a_fault_holds_the_robot_until_it_is_switched_off_and_on(seed):
    held = trial(seed)
    assert held.kind == FAULTS[seed]
    judge_trial(held)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1504))
def test_500_faults_at_random_times_hold_the_robot(seed):
    judge_trial(trial(seed))


def test_the_same_seed_gives_the_same_approach():
    def moves(seed):
        run = Run(seed)
        run.start()
        run.until(START_MS + 300)
        return run.robot.moves

    assert moves(3) == moves(3)
    assert moves(3) != moves(4)


def test_the_reports_say_why_the_robot_is_held():
    run = Run(5)
    run.start()
    run.until(START_MS + 300)
    assert run.reports[-1][1].is_moving
    run.arm.request("pause")
    run.until(START_MS + 500)
    assert run.reports[-1][1].reasons == (HOLDS["is_robot_ready"], LATCHED)


def test_a_robot_that_does_not_follow_is_not_led_further():
    run = Run(6)
    run.start()
    run.until(START_MS + 600)
    run.arm.arm.command = lambda *_: None
    run.until(START_MS + 2500)
    reasons = run.reports[-1][1].reasons
    assert LATCHED in reasons
    last = run.robot.moves[-1][1]
    lag_mm = np.linalg.norm(np.subtract(last.position_mm, run.arm.true_pose().position_mm))
    assert 1.0 < lag_mm < 2.3
    assert any(HOLDS["is_following"] in report.reasons for _, report in run.reports)


def test_after_a_pause_of_the_hand_motion_continues_without_a_step():
    """The clutch is released and pressed: the arm is still on its way when it is pressed again."""
    run = Run(7)
    run.start()
    run.until(START_MS + 7000)
    steps_mm = [
        np.linalg.norm(np.subtract(after.position_mm, before.position_mm))
        for (_, before), (_, after) in zip(run.robot.moves, run.robot.moves[1:], strict=False)
    ]
    gaps_ns = np.diff([stamp_ns for stamp_ns, _ in run.robot.moves])
    assert gaps_ns.max() > 250e6  # the release
    assert max(steps_mm) < 0.25  # errors of the measured pose at which it starts again


def test_the_table_names_what_came_too_late(capsys):
    report_trials([Held("paused", 51.0, 60.0, 0, True), Held("paused", -3.0, 20.0, 0, True)])
    output = capsys.readouterr().out
    assert "1 commanded motion later than 50 ms" in output
    assert "paused              2       51.0" in output
