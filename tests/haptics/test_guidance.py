from itertools import pairwise

import pytest
from helpers import MS
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.haptics.guidance import Guidance, followed
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.messages import OFF, UNKNOWN, Conclusion, Follow, HapticCommand, Pattern

STRONGER = Follow("amplitude", "theta_deg", start=(1.7, 0.2), end=(10.0, 0.6))
QUICKER = Follow("rate_hz", "distance_to_retina_mm", start=(5.0, 1.0), end=(1.0, 5.0), dead_band=0.5)
LEAN = Pattern("lean", "continuous", amplitude=0.3, frequency_hz=80, follow=(STRONGER,))
NEAR = Pattern("near", "pulses", amplitude=0.5, on_ms=100, off_ms=400, follow=(QUICKER,))

number = st.floats(-1e6, 1e6)


def follows(curve: float = 1.0):
    ends = st.tuples(number, st.floats(0.01, 1.0))
    return st.builds(
        Follow, st.just("amplitude"), st.just("theta_deg"), start=ends, end=ends, curve=st.just(curve)
    ).filter(lambda follow: abs(follow.start[0] - follow.end[0]) > 1e-3)


@given(follows(2.0), number)
def test_a_followed_number_stays_between_its_ends(follow, value):
    low, high = sorted((follow.start[1], follow.end[1]))
    assert low - 1e-9 <= followed(follow, value) <= high + 1e-9


@given(follows(), number, number)
def test_a_followed_number_is_monotonic_in_the_measure(follow, one, other):
    one, other = sorted((one, other))
    rises = (follow.end[1] - follow.start[1]) * (follow.end[0] - follow.start[0])
    change = followed(follow, other) - followed(follow, one)
    assert change * rises >= -1e-9


def test_amplitude_grows_with_the_angle_up_to_its_end():
    guide = Guidance()
    amplitudes = [guide(LEAN, {"theta_deg": theta}).amplitude for theta in (0.0, 1.7, 5.85, 10.0, 40.0)]
    assert amplitudes == pytest.approx([0.2, 0.2, 0.4, 0.6, 0.6])


def test_a_curve_of_2_is_quadratic():
    slow = Follow("amplitude", "theta_deg", start=(0.0, 0.0), end=(10.0, 1.0), curve=2.0)
    assert followed(slow, 5.0) == 0.25


def test_without_the_measure_the_number_of_the_pattern_is_kept():
    assert Guidance()(LEAN, {}).amplitude == 0.3


def test_a_resolved_pattern_has_no_follow_tables():
    assert Guidance()(LEAN, {"theta_deg": 3.0}).follow == ()


def test_noise_within_the_dead_band_changes_nothing():
    guide = Guidance()
    first = guide(NEAR, {"distance_to_retina_mm": 3.0})
    assert guide(NEAR, {"distance_to_retina_mm": 3.5}) == first
    assert guide(NEAR, {"distance_to_retina_mm": 2.5}) == first
    assert guide(NEAR, {"distance_to_retina_mm": 2.4}) != first
    guide.reset()
    assert guide(NEAR, {"distance_to_retina_mm": 3.4}) != first


def test_reset_of_the_renderer_forgets_the_followed_measure():
    render = GrammarRenderer([OFF, NEAR])

    def play(distance_mm: float) -> Pattern:
        return render(
            Conclusion(0, "near", 0, "near", "", measures={"distance_to_retina_mm": distance_mm})
        ).pattern

    first = play(3.0)
    assert play(3.4) == first  # within the dead band
    render.reset()
    assert play(3.4) == Guidance()(NEAR, {"distance_to_retina_mm": 3.4}) != first


def test_a_rate_sets_the_pauses():
    pattern = Guidance()(NEAR, {"distance_to_retina_mm": 1.0})
    assert (pattern.on_ms, pattern.off_ms) == (100, 100)


def commands(states, distances_mm):
    """The commands at 30 images/s."""
    render = GrammarRenderer([OFF, NEAR])
    for index, (state, distance_mm) in enumerate(zip(states, distances_mm, strict=True)):
        feel = "near" if state == "near" else "off"
        measures = {"distance_to_retina_mm": distance_mm} if feel == "near" else {}
        yield render(Conclusion(index * 33 * MS, state, 0, feel, "", measures=measures))


def onsets_ms(played: list[HapticCommand]) -> list[int]:
    """The times at which vibration begins, to the millisecond; each command is played until the next."""
    onsets, before = [], 0.0
    for command in played:
        for ms in range(33):
            now = amplitude_at(command, command.stamp_ns + ms * MS)
            if now and not before:
                onsets.append(command.stamp_ns // MS + ms)
            before = now
    return onsets


def test_pulses_of_increasing_rate_keep_their_rhythm():
    distances_mm = [5.0 - 0.04 * index for index in range(100)]
    onsets = onsets_ms(list(commands(["near"] * 100, distances_mm)))
    gaps = [later - earlier for earlier, later in pairwise(onsets)]
    assert len(gaps) > 6
    assert gaps[0] > 600
    assert gaps[-1] < 260
    assert all(later <= earlier + 33 for earlier, later in pairwise(gaps))


@given(st.lists(st.floats(0.5, 6.0), min_size=60, max_size=60))
def test_pulses_and_pauses_stay_within_the_ends_however_the_measure_jumps(distances_mm):
    played = list(commands(["near"] * 60, distances_mm))
    levels = [amplitude_at(one, one.stamp_ns + ms * MS) > 0 for one in played for ms in range(33)]
    edges = [ms for ms in range(1, len(levels)) if levels[ms] != levels[ms - 1]]
    for start, end in pairwise(edges):
        assert 99 <= end - start <= (101 if levels[start] else 901)


def test_losing_the_needle_ends_guidance():
    played = list(commands(["near", "near", UNKNOWN], [3.0, 2.0, 2.0]))
    assert played[-1].pattern == OFF
