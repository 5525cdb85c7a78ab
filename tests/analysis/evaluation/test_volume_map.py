import numpy as np
import pytest

from haptigraph.analysis.evaluation.drift_clock import estimate_clock
from haptigraph.analysis.evaluation.volume_map import QuadraticMap, fit_offset_mm
from haptigraph.perception.instrument.rotations import euler_xyz_matrix

NOISE, STEP = 0.004, 0.08


def scene(seed, n=240):
    """Return measurements, hours, labels without and with a drift that steps at 10 h; all with noise."""
    rng = np.random.default_rng(seed)
    measured, hours = rng.uniform(-0.5, 0.5, (n, 6)), np.sort(rng.uniform(0, 21, n))
    still = measured @ [1, 0.2, -0.1, 0.5, 0.1, 0] + 0.1 * measured[:, 0] * measured[:, 1]
    still = still + rng.normal(0, NOISE, n)
    return measured, hours, still, still - STEP * (hours > 10) + 0.002 * hours


def test_a_quadratic_map_predicts_to_the_noise_within_its_standard_deviations():
    measured, hours, still, _ = scene(1)
    fitted = QuadraticMap(measured[::2], hours[::2], still[::2], has_drift=False)
    predicted = fitted.predict(measured[1::2], hours[1::2])
    errors = still[1::2] - predicted.values
    assert errors.std() < 1.3 * NOISE
    assert 0.8 < np.percentile(np.abs(errors) / predicted.sds, 68) < 1.2


def test_a_drift_with_a_step_is_followed_and_the_step_is_uncertain():
    measured, hours, _, drifting = scene(2)
    without, with_ = (
        QuadraticMap(measured[::2], hours[::2], drifting[::2], has_drift=drifts).predict(
            measured[1::2], hours[1::2]
        )
        for drifts in (False, True)
    )
    errors = drifting[1::2] - with_.values
    assert np.median(np.abs(errors)) < 1.2 * NOISE
    assert np.median(np.abs(drifting[1::2] - without.values)) > 3 * NOISE
    z = np.abs(errors) / with_.sds
    assert 0.75 < np.percentile(z, 68) < 1.25
    assert np.percentile(z, 95) < 2.6
    before, after = hours[::2][hours[::2] < 10].max(), hours[::2][hours[::2] > 10].min()
    inside = with_if_between(measured, hours, drifting, (before + after) / 2)
    assert inside > 2 * np.median(with_.sds)


def with_if_between(measured, hours, labels, hour):
    fitted = QuadraticMap(measured[::2], hours[::2], labels[::2], has_drift=True)
    return fitted.predict(measured[:1], np.array([hour])).sds[0]


def test_the_clock_runs_fast_where_the_drift_steps():
    rng = np.random.default_rng(3)
    hours = np.linspace(0, 20, 100)
    clock = estimate_clock(hours, STEP * (hours > 10) + rng.normal(0, NOISE, 100))
    speeds = np.diff(clock.readings)
    assert 9.7 < hours[speeds.argmax()] < 10
    assert speeds.max() > 50 * np.median(speeds)
    readings = clock.at(np.array([-9.0, -1.0, 0.0, 20.0, 21.0]))
    assert (np.diff(readings) > 0).all()
    assert readings[0] == 0


def test_the_tip_is_found_beside_the_labelled_position():
    rng = np.random.default_rng(4)
    offset = np.array([0.4, -2.1, 1.2])
    positions = rng.uniform(0, 1, (60, 3))
    rotations = np.array([euler_xyz_matrix(angles) for angles in rng.uniform(0, 8, (60, 3))])
    tips = positions + rotations @ offset
    bent = tips + 0.02 * tips[:, [1]] ** 2
    found = fit_offset_mm(bent + rng.normal(0, 0.002, bent.shape), positions, rotations)
    assert found == pytest.approx(offset, abs=0.05)
