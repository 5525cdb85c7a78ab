from haptigraph.geometry import Point
from haptigraph.messages import Capture, Observation, RobotSample
from haptigraph.perception.robot_tip import AHEAD_MS, RobotTipPerceiver

MS = 1_000_000


def perceiver(timing_sd_ms=0.0):
    class Nothing:
        def __call__(self, capture):
            return Observation(capture.stamp_ns)

        def reset(self):
            pass

    return RobotTipPerceiver(Nothing(), timing_sd_ms)


def sample(at_ms, x_mm, sd_mm=0.1):
    return RobotSample(
        round(at_ms * MS),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 1.0),
        eye_tip_mm=(x_mm, 1.0, 2.0),
        eye_tip_sd_mm=sd_mm,
    )


def capture(at_ms, *samples):
    return Capture(0, round(at_ms * MS), None, robot=samples)


def test_between_two_samples_the_tip_is_interpolated_and_its_z_kept():
    found = perceiver()(capture(10, sample(0, 0.0), sample(20, 4.0)))
    assert found.found["robot_tip"] == Point((2.0, 1.0), 2.0)
    assert found.sd_mm["robot_tip"] == 0.1


def test_after_the_newest_sample_it_goes_on_with_its_speed_and_a_larger_sd():
    found = perceiver()(capture(30, sample(0, 0.0), sample(20, 2.0)))
    assert found.found["robot_tip"].at_mm[0] == 3.0
    assert found.sd_mm["robot_tip"] > 0.1


def test_what_is_uncertain_about_time_counts_with_the_speed():
    found = perceiver(timing_sd_ms=10.0)(capture(10, sample(0, 0.0, 0.3), sample(20, 0.8, 0.3)))
    assert abs(found.sd_mm["robot_tip"] - 0.5) < 1e-9  # 0.04 mm/ms for 10 ms, and 0.3 mm


def test_a_stale_pose_is_not_reported_and_said_once():
    perceive = perceiver()
    assert "robot_tip" in perceive(capture(20, sample(0, 0.0), sample(20, 0.0))).found
    stale = [perceive(capture(20 + AHEAD_MS + more)) for more in (0, 1, 2)]
    assert "robot_tip" in stale[0].found and not stale[0].faults
    assert "robot_tip" not in stale[1].found and stale[1].faults[0].where == "robot"
    assert not stale[2].faults
    again = perceive(capture(100, sample(99, 0.0), sample(100, 0.0)))
    assert "robot_tip" in again.found


def test_a_gap_between_two_samples_is_not_bridged():
    assert "robot_tip" not in perceiver()(capture(50, sample(0, 0.0), sample(100, 4.0))).found


def test_without_calibration_or_its_uncertainty_there_is_no_tip():
    bare = RobotSample(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for one in (bare, sample(0, 0.0, None)):
        found = perceiver()(capture(1, one))
        assert "robot_tip" not in found.found and "not calibrated" in found.faults[0].message


def test_reset_forgets_the_samples():
    perceive = perceiver()
    perceive(capture(20, sample(0, 0.0), sample(20, 0.0)))
    perceive.reset()
    assert "robot_tip" not in perceive(capture(25)).found
