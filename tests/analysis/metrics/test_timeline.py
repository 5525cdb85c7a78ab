"""A run as columns: it preserves commands, states, measures and faults."""

import math
from itertools import pairwise

from helpers import LOW, MS, PULSE, SUCCESS, make_step
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.analysis.metrics.timeline import Timeline
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.messages import OFF, Fault


@st.composite
def runs(draw):
    """Steps at irregular times; patterns start when they are first commanded."""
    steps, stamp_ns, since_ns, before = [], 0, 0, None
    for _ in range(draw(st.integers(1, 20))):
        pattern = draw(st.sampled_from((OFF, LOW, PULSE, SUCCESS)))
        since_ns = since_ns if pattern is before else stamp_ns
        steps.append(make_step(pattern, stamp_ns=stamp_ns, since_ns=since_ns))
        stamp_ns, before = stamp_ns + draw(st.integers(1, 400)) * MS, pattern
    return steps


@given(runs())
def test_edges_reproduce_the_commanded_amplitude_at_every_moment(steps):
    timeline = Timeline((), ())
    for step in steps:
        timeline.add(step)
    edges = list(zip(timeline.edge_ms, timeline.edge_amplitude, strict=True))
    for step, later in pairwise(steps):
        for stamp_ns in range(step.stamp_ns, later.stamp_ns, 5 * MS):
            past = [amplitude for at_ms, amplitude in edges if at_ms <= stamp_ns / MS]
            assert math.isclose(past[-1] if past else 0.0, amplitude_at(step.command, stamp_ns), abs_tol=1e-6)


def test_states_measures_and_patterns_are_columns():
    timeline = Timeline(("unknown",), ("theta_deg",))
    for stamp_ns, pattern, state in ((5 * MS, OFF, "unknown"), (40 * MS, LOW, "new")):
        timeline.add(make_step(pattern, stamp_ns=stamp_ns, state=state))
    assert list(timeline.time_ms) == [0.0, 35.0]
    assert [timeline.states[index] for index in timeline.state] == ["unknown", "new"]
    assert [timeline.patterns[index] for index in timeline.plays] == ["off", "low"]
    assert all(math.isnan(value) for value in timeline.measures["theta_deg"])


def spans(*faults: tuple[Fault, ...]) -> list[tuple[int, int, str, str]]:
    """Return the spans of the faults of consecutive steps."""
    timeline = Timeline((), ())
    for number, each in enumerate(faults):
        timeline.add(make_step(stamp_ns=number * MS, faults=each))
    return [(span.first, span.last, span.message, span.ended) for span in timeline.faults]


STALE, SLOW = Fault("source", "stale image"), Fault("recorder", "too slow")
GONE, BACK = Fault("device", "gone"), Fault("device", "responds again", is_over=True)


def test_a_fault_that_persists_is_one_span():
    assert spans((), (STALE,), (STALE, SLOW), (), (STALE,)) == [
        (1, 2, "stale image", ""),
        (2, 2, "too slow", ""),
        (4, 4, "stale image", ""),
    ]


def test_a_fault_of_the_device_lasts_until_it_responds_again():
    assert spans((), (GONE,), (), (STALE,), (BACK,), (), (GONE,), ()) == [
        (1, 3, "gone", "responds again"),
        (3, 3, "stale image", ""),
        (6, 7, "gone", ""),
    ]


def test_a_device_may_fail_and_respond_within_one_step():
    assert spans((GONE, BACK), (), (GONE,), (BACK, GONE), (BACK, GONE, BACK)) == [
        (0, 0, "gone", "responds again"),
        (2, 2, "gone", "responds again"),
        (3, 3, "gone", "responds again"),
        (4, 4, "gone", "responds again"),
    ]
