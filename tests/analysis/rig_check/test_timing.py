"""Rate, evenness and gaps of the images, from their stamps alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.analysis.rig_check.clip import Clip
from haptigraph.analysis.rig_check.timing import timing

NOMINAL_HZ = 30.0


def clip(times_s, indices=None, *, is_timed=True, losses=()):
    stamps_ns = np.rint(1e9 * np.asarray(times_s)).astype(np.int64)
    indices = np.arange(len(stamps_ns)) if indices is None else np.asarray(indices)
    return Clip((), (), stamps_ns, indices, NOMINAL_HZ, is_timed, losses)


def names(subject):
    return [finding.name for finding in subject.findings]


@given(rate_hz=st.floats(28, 120), jitter=st.floats(0, 0.15), seed=st.integers(0, 99))
def test_an_even_rate_passes_whatever_it_is(rate_hz, jitter, seed):
    off = np.random.default_rng(seed).uniform(-jitter, jitter, 100)
    assert names(timing(clip((np.arange(100) + off) / rate_hz))) == []


@given(rate_hz=st.floats(2, 24))
def test_a_low_rate_is_found(rate_hz):
    subject = timing(clip(np.arange(60) / rate_hz))
    assert names(subject)[0] == "frame_rate"
    assert subject.measurements["rate_hz"] == pytest.approx(rate_hz, rel=1e-6)


def test_alternating_intervals_are_uneven():
    times_s = np.cumsum(np.tile([0.01, 0.05], 40))
    assert "uneven_rate" in names(timing(clip(times_s)))


def test_missing_images_are_counted():
    times_s = np.delete(np.arange(100) / NOMINAL_HZ, [20, 41, 42, 43, 44, 70])
    subject = timing(clip(times_s))
    assert "missing_images" in names(subject)
    assert subject.measurements["missing_share"] == pytest.approx(0.06)
    assert subject.measurements["longest_gap_ms"] == pytest.approx(5e3 / NOMINAL_HZ)


def test_images_that_the_check_itself_did_not_take_are_no_gap():
    kept = np.delete(np.arange(100), [20, 41, 42])
    subject = timing(clip(kept / NOMINAL_HZ, kept))
    assert names(subject) == []
    assert subject.measurements["not_taken"] == 3
    assert subject.measurements["rate_hz"] == pytest.approx(NOMINAL_HZ)


def test_a_lost_source_is_a_finding():
    assert "source_lost" in names(timing(clip(np.arange(60) / NOMINAL_HZ, losses=("camera:0 is gone",))))


def test_times_that_are_a_setting_are_not_judged():
    subject = timing(clip(np.arange(60) / 5, is_timed=False))
    assert subject.outcome == "not judged"
    assert subject.findings == ()
