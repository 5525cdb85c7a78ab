import pytest
from helpers import needle

from haptigraph import assemble
from haptigraph.analysis.evaluation.angle_noise import angle_noise
from haptigraph.config import load_config
from haptigraph.messages import Observation

SMALL = (480, 270)


class Noisy:
    """Reports angles of 1 and -1 degree alternately."""

    entities = frozenset(("needle_tip", "needle_line"))
    entities_with_sd = frozenset()
    images = "eye"

    def __init__(self, registration, config):
        pass

    def __call__(self, capture):
        side = 0.17455 if capture.index % 2 else -0.17455
        return Observation(capture.stamp_ns, needle((0.0, 10.0), (side, 0.0)))

    def reset(self):
        pass


class Blind(Noisy):
    def __call__(self, capture):
        return Observation(capture.stamp_ns, {})


def test_noise_is_the_standard_deviation_of_the_reported_shaft(monkeypatch):
    for name in ("Noisy", "Blind"):
        monkeypatch.setitem(assemble.PERCEIVERS, name.lower(), f"{__name__}:{name}")
    names, progress = ["noisy", "blind"], []
    (held,) = angle_noise(
        names, load_config(), depths_mm=(6.0,), size_px=SMALL, progress=lambda *now: progress.append(now)
    )
    assert held.depth_mm == 6.0
    assert held.noise_deg["noisy"] == pytest.approx(1.0, rel=0.03)
    assert held.noise_deg["blind"] is None
    assert held.tip_noise_mm["noisy"] == pytest.approx(0.17455, rel=0.03)
    assert held.tip_noise_mm["blind"] is None
    assert progress[-1] == ("measuring noise", 1, 1)


def test_the_reference_method_is_above_the_bound():
    (held,) = angle_noise(
        ["threshold"], load_config(None, ("perception.alpha=1",)), depths_mm=(8.0,), size_px=(640, 360)
    )
    assert held.bound.inside_deg < held.noise_deg["threshold"] < 1
