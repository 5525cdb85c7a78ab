"""The tip's prediction to the moment of output."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.perception.volume.ahead import AheadSettings, TipAhead, imaged_ns
from haptigraph.perception.volume.surfaces import HeightMap

PERIOD_NS = 250_000_000
SD = np.full(3, 0.005)
SETTINGS = AheadSettings()


def flat(height_mm):
    ends = np.array([-1.0, 1.0])
    return HeightMap(ends, ends, np.full((2, 2), height_mm), np.ones((2, 2), bool), np.full((2, 2), 0.004))


def followed(tips, surfaces=None, settings=SETTINGS):
    """What is predicted after each of the tips."""
    ahead = TipAhead(settings)
    surfaces = surfaces or [flat(0.0)] * len(tips)
    return [
        ahead.update(number * PERIOD_NS, number * PERIOD_NS, tip, SD, surface)
        for number, (tip, surface) in enumerate(zip(tips, surfaces, strict=True))
    ]


speeds = st.floats(-0.4, 0.4)


@given(speeds, speeds, speeds)
def test_at_constant_velocity_the_prediction_converges_to_the_truth(x, y, z):
    velocity = np.array([x, y, z])
    tips = [velocity * 0.25 * number for number in range(12)]
    last = followed(tips)[-1]
    expected = tips[-1] + velocity * SETTINGS.horizon_s
    assert last.tip_mm == pytest.approx(expected, abs=0.004)
    assert (np.abs(last.tip_mm - expected) < last.sd_mm).all()
    assert last.velocity_mm_s == pytest.approx(velocity, abs=0.02)


def test_a_retina_that_rises_towards_a_still_tip_is_an_approach():
    rise_mm = 0.03
    tips = [np.array([0.0, 0.5, 0.0])] * 12
    surfaces = [flat(rise_mm * number) for number in range(12)]
    last = followed(tips, surfaces)[-1]
    later_gap = 0.5 - rise_mm * 11 - rise_mm / 0.25 * SETTINGS.horizon_s
    assert last.tip_mm[1] - rise_mm * 11 == pytest.approx(later_gap, abs=0.006)


def test_tip_and_retina_that_move_together_do_not_approach():
    tips = [np.array([0.0, 0.3 + 0.02 * number, 0.0]) for number in range(12)]
    surfaces = [flat(0.02 * number) for number in range(12)]
    last = followed(tips, surfaces)[-1]
    assert last.tip_mm[1] - 0.02 * 11 == pytest.approx(0.3, abs=0.006)


def test_the_uncertainty_grows_with_the_horizon_and_without_a_tip():
    tips = [np.array([0.0, -0.02 * number, 0.0]) for number in range(8)]
    sds = [
        followed(tips, settings=replace(SETTINGS, latency_s=latency))[-1].sd_mm for latency in (0.0, 0.1, 0.3)
    ]
    assert (sds[0] < sds[1]).all() and (sds[1] < sds[2]).all()
    coasting = followed([*tips, *[None] * 16])
    assert coasting[8].tip_mm[1] < tips[-1][1] - 0.02
    assert coasting[8].sd_mm[1] > coasting[7].sd_mm[1]
    assert coasting[-1] is None  # too uncertain by now


def test_without_any_tip_nothing_is_predicted():
    assert followed([None, None]) == [None, None]


def test_a_jump_starts_again_with_an_unknown_velocity():
    tips = [np.array([0.0, -0.05 * number, 0.0]) for number in range(10)]
    jumped = followed([*tips, np.array([0.4, 0.5, 0.0])])[-1]
    assert jumped.tip_mm == pytest.approx([0.4, 0.5, 0.0], abs=0.01)
    assert jumped.sd_mm.max() > 0.07


def test_the_standard_deviation_is_that_of_the_error():
    """Random accelerations as in the settings, and random errors."""
    rng, z = np.random.default_rng(4), []
    for _ in range(120):
        velocity, at, tips = rng.normal(0, 0.15, 3), np.zeros(3), []
        states = []
        for _ in range(16):
            push = rng.normal(0, SETTINGS.tip_mm_s2, 3)
            at, velocity = at + velocity * 0.25 + push * 0.25**2 / 2, velocity + push * 0.25
            states.append((at, velocity))
            tips.append(at + rng.normal(0, 0.005, 3))
        predicted = followed(tips[:-2], settings=replace(SETTINGS, latency_s=0.0))[-1]
        z.append(((predicted.tip_mm - states[-2][0]) / predicted.sd_mm)[[0, 2]])
    assert 0.75 < np.percentile(np.abs(z), 68.3) < 1.1


def test_a_stamp_that_goes_back_starts_again():
    ahead = TipAhead(SETTINGS)
    for stamp in (0, PERIOD_NS, 2 * PERIOD_NS, PERIOD_NS):
        last = ahead.update(stamp, stamp, np.array([0.0, -stamp * 1e-10, 0.0]), SD, flat(0.0))
    assert last.velocity_mm_s == pytest.approx(np.zeros(3))


def test_a_slice_was_acquired_before_the_end_of_its_volume():
    surface = flat(0.0)
    assert imaged_ns(PERIOD_NS, 1.0, surface, 0.25) == PERIOD_NS
    assert imaged_ns(PERIOD_NS, -1.0, surface, 0.25) == 0
    assert imaged_ns(PERIOD_NS, 0.0, surface, 0.25) == PERIOD_NS // 2
    assert imaged_ns(PERIOD_NS, -1.0, surface, 0.0) == PERIOD_NS
