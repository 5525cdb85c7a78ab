import math

import pytest
from helpers import needle

from haptigraph import assemble
from haptigraph.analysis.evaluation.angle_noise import THETA_DEG, angle_noise
from haptigraph.config import load_config
from haptigraph.messages import Observation
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits

SMALL = (480, 270)


EYE = Eye(EyeShape())


def held_needle(turn_deg):
    """Return the needle as `angle_noise` holds it at 6 mm, turned about the trocar."""
    robot = Robot(EYE.trocar_mm, RobotLimits(), Pose(0.0, 0.0))
    pose = Pose(6.0, robot.pitch_towards(EYE.target_mm) + THETA_DEG + turn_deg)
    return needle(EYE.trocar_mm, Robot(EYE.trocar_mm, RobotLimits(), pose).tip_mm())


class Noisy:
    """Reports angles of 1 and -1 degree from the truth alternately."""

    entities = frozenset(("needle_tip", "needle_line"))
    entities_with_sd = frozenset()
    images = "eye"

    def __init__(self, registration, config):
        pass

    def __call__(self, capture):
        return Observation(capture.stamp_ns, held_needle(1.0 if capture.index % 2 else -1.0))

    def reset(self):
        pass


class Blind(Noisy):
    def __call__(self, capture):
        return Observation(capture.stamp_ns, {})


class Stuck(Noisy):
    """Takes something else for the needle, always at the same place."""

    def __call__(self, capture):
        return Observation(capture.stamp_ns, needle((0.0, -10.0), (3.0, 0.0)))


def test_noise_is_the_standard_deviation_of_the_reported_shaft(monkeypatch):
    for name in ("Noisy", "Blind", "Stuck"):
        monkeypatch.setitem(assemble.PERCEIVERS, name.lower(), f"{__name__}:{name}")
    names, progress = ["noisy", "blind", "stuck"], []
    (held,) = angle_noise(
        names, load_config(), depths_mm=(6.0,), size_px=SMALL, progress=lambda *now: progress.append(now)
    )
    assert held.depth_mm == 6.0
    assert held.noise_deg["noisy"] == pytest.approx(1.0, rel=0.03)
    assert held.noise_deg["blind"] is held.noise_deg["stuck"] is None
    assert 0.01 < held.tip_noise_mm["noisy"] < 6.0 * math.tan(math.radians(1.0)) * 1.03
    assert held.tip_noise_mm["blind"] is held.tip_noise_mm["stuck"] is None
    assert progress[-1] == ("measuring noise", 1, 1)


def test_the_reference_method_is_above_the_bound():
    (held,) = angle_noise(
        ["threshold"], load_config(None, ("perception.alpha=1",)), depths_mm=(8.0,), size_px=(640, 360)
    )
    assert held.bound.inside_deg < held.noise_deg["threshold"] < 1
