"""The compiled tip network computes what its definition says, and combines it with a contrast step."""

import ctypes
import math

import numpy as np
import pytest
from drawn_strip import END_PX, HALF_PX, U_PX, needle, strip

from haptigraph.perception.native.library import LIBRARY
from haptigraph.perception.native.tip_network import (
    KINDS,
    PLACES,
    STATIONS,
    VALUES,
    WEIGHTS,
    judge_tip,
    tip_window,
)
from training import tip_shape
from training.tip_shape import ACROSS, BEHIND, LANE_MM, SIDE, STEP_MM

PX_PER_MM = 20.0
FEATURES, TAPS, LAYERS = 24, 5, 4
LANES = np.arange(-HALF_PX, HALF_PX + 1)[:, None]


def tip_places(weights, window, context):
    """The probabilities of all places by the compiled network."""
    values, places = window.copy(), np.empty(KINDS)
    given = weights.ctypes.data, values.ctypes.data, (ctypes.c_double * 3)(*context), places.ctypes.data
    LIBRARY.function("tip_places", "pppp")(*given)
    return places


def tip_posterior(places, px_per_mm):
    """How far a tip is beyond the apparent one, its standard deviation, and how probably it is far."""
    tip = (ctypes.c_double * 3)()
    LIBRARY.function("tip_posterior", "pdp")(places.ctypes.data, px_per_mm, tip)
    return tuple(tip)


def rows_of(window):
    return window.reshape(-1, STATIONS)


def test_a_window_lies_along_the_shaft_and_across_it_in_millimetres():
    ramp = strip(np.zeros((2 * HALF_PX + 1, len(U_PX))))
    shown = np.broadcast_to(100.0 * LANES + U_PX, ramp.excess.shape)
    ramp.excess[:] = shown
    rows = rows_of(tip_window(ramp, 2.0, 0.01, END_PX, PX_PER_MM))
    u_px = END_PX + (np.arange(STATIONS) - BEHIND) * STEP_MM * PX_PER_MM
    lanes = 2.0 + 0.01 * u_px + np.arange(-SIDE, SIDE + 1)[:, None] * LANE_MM * PX_PER_MM
    assert rows[:ACROSS] == pytest.approx(100 * lanes + u_px, abs=0.05)
    assert np.all(rows[-1] == 1)


def test_nothing_is_seen_beyond_the_globe():
    near = strip(needle(4.0))
    rows = rows_of(tip_window(near, 0.0, 0.0, float(near.u_px[near.inside.start]) + 10, PX_PER_MM))
    assert 0 < rows[-1].sum() < STATIONS
    assert np.all(rows[:, rows[-1] == 0] == 0)
    assert not tip_window(near, 0.0, 0.0, 1e9, PX_PER_MM).any()


def test_before_the_globe_nothing_is_seen_of_the_wall_and_beyond_it():
    near = strip(needle(4.0))
    last = near.outside.stop - 1
    rows = rows_of(tip_window(near, 0.0, 0.0, float(near.u_px[last]), PX_PER_MM, is_outside=True))
    assert 0 < rows[-1].sum() < STATIONS and not rows[-1, BEHIND:].any()
    assert np.all(rows[:, rows[-1] == 0] == 0)


def expected_places(weights, window, context):
    """The network's definition, in NumPy."""
    at = 0

    def take(*shape):
        nonlocal at
        at += math.prod(shape)
        return weights[at - math.prod(shape) : at].reshape(shape).astype(float)

    rows = rows_of(window).astype(float)
    channels = rows[:-1].reshape(3, ACROSS, STATIONS)
    contrast = np.sqrt(np.square(channels[:, :, : BEHIND - 4]).mean(axis=(1, 2)))
    unit = contrast[0] + 0.5 * contrast[2] + 1
    noise_grey, px_per_mm, sd_px = context
    whole = np.log([(noise_grey + 1) / unit, px_per_mm / 18, sd_px + 0.1])[:, None].repeat(STATIONS, 1)
    is_step = np.arange(STATIONS)[None] == BEHIND
    given = np.concatenate([np.clip(rows[:-1] / unit, -4, 4), rows[-1:], whole, is_step])
    features = np.maximum(take(FEATURES, len(given)) @ given + take(FEATURES)[:, None], 0)
    layers = take(LAYERS, FEATURES, FEATURES, TAPS), take(LAYERS, FEATURES)
    for n, (layer, bias) in enumerate(zip(*layers, strict=True)):
        reach = (TAPS // 2) << n
        padded = np.pad(features, ((0, 0), (reach, reach)))
        shifted = [padded[:, tap << n : (tap << n) + STATIONS] for tap in range(TAPS)]
        sums = sum(layer[:, :, tap] @ shifted[tap] for tap in range(TAPS)) + bias[:, None]
        features = features + np.maximum(sums, 0)
    places = take(FEATURES) @ features + take(1)
    elsewhere = take(FEATURES) @ features.max(axis=1) + take(1)
    steps = take(2, FEATURES) @ features[:, BEHIND] + take(2)
    logits = np.concatenate([places[BEHIND - PLACES // 2 : BEHIND + PLACES // 2], elsewhere, steps])
    assert at == WEIGHTS == len(weights)
    exponentials = np.exp(logits - logits.max())
    return exponentials / exponentials.sum()


@pytest.mark.parametrize("seed", range(5))
def test_the_places_are_those_of_the_networks_definition(seed):
    rng = np.random.default_rng(seed)
    weights = rng.normal(0, 0.15, WEIGHTS).astype(np.float32)
    window = rng.normal(0, 20, VALUES).astype(np.float32)
    expected = expected_places(weights, window, (3.0, 15.0, 0.2))
    places = tip_places(weights, window, (3.0, 15.0, 0.2))
    assert places == pytest.approx(expected, rel=1e-3, abs=1e-6)
    assert places.sum() == pytest.approx(1)


def test_a_tip_is_judged_by_what_its_window_shows():
    weights = np.random.default_rng(3).normal(0, 0.15, WEIGHTS).astype(np.float32)
    drawn, line, at_px = strip(needle(4.0)), (0.4, 0.01), END_PX + 3
    places = tip_places(
        weights, tip_window(drawn, *line, at_px, PX_PER_MM), (drawn.noise_grey, PX_PER_MM, 0.2)
    )
    judged = judge_tip(drawn, weights, line, (at_px, 0.2), PX_PER_MM)
    assert judged == tip_posterior(places, PX_PER_MM)
    assert judged != judge_tip(drawn, weights, line, (at_px, 0.2), PX_PER_MM, is_outside=True)


def test_the_network_is_trained_in_the_shape_that_it_has():
    assert (tip_shape.FEATURES, tip_shape.TAPS, tip_shape.LAYERS) == (FEATURES, TAPS, LAYERS)
    assert (tip_shape.CONTEXT, tip_shape.USUAL_PX_PER_MM, tip_shape.MIN_SD_PX) == (3, 18, 0.1)
    sds_mm = [tip_posterior(at_places(kind), PX_PER_MM)[1] for kind in (MIDDLE, PRECISE, COARSE)]
    assert sds_mm == pytest.approx([tip_shape.PLACE_SD_MM, *np.divide(tip_shape.STEP_SD_PX, PX_PER_MM)])


def at_places(*numbers):
    places = np.zeros(KINDS)
    for number in numbers:
        places[number] += 1 / len(numbers)
    return places


MIDDLE, NOWHERE, PRECISE, COARSE = PLACES // 2, PLACES, PLACES + 1, PLACES + 2


def test_a_contrast_step_that_is_the_tip_stays_and_is_as_certain_as_it_is_precise():
    beyond_mm, sd_mm, far = tip_posterior(at_places(PRECISE), PX_PER_MM)
    assert (beyond_mm, far) == (0, 0)
    assert sd_mm == pytest.approx(0.3 / PX_PER_MM)
    assert tip_posterior(at_places(COARSE), PX_PER_MM)[1] == pytest.approx(1.0 / PX_PER_MM)


def test_a_network_that_is_sure_of_another_place_moves_the_tip_there():
    beyond_mm, sd_mm, far = tip_posterior(at_places(MIDDLE + 5), PX_PER_MM)
    assert beyond_mm == pytest.approx(5 * STEP_MM)
    assert sd_mm == pytest.approx(0.05)
    assert far == pytest.approx(0, abs=1e-9)


def test_two_places_near_each_other_leave_a_tip_uncertain_between_them():
    beyond_mm, sd_mm, far = tip_posterior(at_places(MIDDLE + 2, MIDDLE + 6), PX_PER_MM)
    assert beyond_mm == pytest.approx(4 * STEP_MM)
    assert sd_mm == pytest.approx(math.hypot(2 * STEP_MM, 0.05))
    assert far == pytest.approx(0, abs=1e-9)


def test_what_is_far_from_the_mean_or_nowhere_is_probably_far():
    assert tip_posterior(at_places(*[MIDDLE] * 9, MIDDLE + 10), PX_PER_MM)[2] > 0.05
    assert tip_posterior(at_places(MIDDLE, NOWHERE), PX_PER_MM)[2] == pytest.approx(0.5)
    assert tip_posterior(at_places(NOWHERE), PX_PER_MM) == (0, 0, 1)


def test_far_is_what_training_takes_for_far():
    apart = int(2 * tip_shape.FAR_MM / STEP_MM)  # either place is half of that from their mean
    assert apart * STEP_MM / 2 < tip_shape.FAR_MM < (apart + 1) * STEP_MM / 2
    near, far = at_places(MIDDLE, MIDDLE + apart), at_places(MIDDLE, MIDDLE + apart + 1)
    assert tip_posterior(near, PX_PER_MM)[2] == pytest.approx(0, abs=1e-9)
    assert tip_posterior(far, PX_PER_MM)[2] == pytest.approx(1)
    scale = tip_shape.FAR_PX / ((apart + 1) * STEP_MM / 2)  # at which the second places are just as far
    assert tip_posterior(far, 0.99 * scale)[2] == pytest.approx(0, abs=1e-9)
    assert tip_posterior(far, 1.01 * scale)[2] == pytest.approx(1)


def test_in_a_coarse_image_two_and_a_half_pixels_are_not_far():
    places = at_places(MIDDLE, MIDDLE + 9)
    assert tip_posterior(places, PX_PER_MM)[2] == pytest.approx(1)
    assert tip_posterior(places, 5.0)[2] == pytest.approx(0, abs=1e-9)
