import pytest
from helpers import LOW, MS, PULSE, SUCCESS
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.haptics.pattern import amplitude_at
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.messages import OFF, TIP_NOT_VISIBLE, UNKNOWN, Conclusion, HapticCommand, Pattern

CHIME = Pattern("chime", "bursts", amplitude=0.5, on_ms=50, off_ms=50, count=3)
PATTERNS = {"contact": "pulse", "hit": "success", "off_course": "low", "on_course": "off", "also_off": "low"}
PATTERNS |= {UNKNOWN: "off", TIP_NOT_VISIBLE: "off", "bell": "chime"}


class Player:
    """Return the command for a state at a time."""

    def __init__(self):
        self.render = GrammarRenderer([OFF, LOW, PULSE, SUCCESS, CHIME])

    def __call__(self, ms: float, state: str):
        return self.render(Conclusion(round(ms * MS), state, 0, PATTERNS[state], ""))


@pytest.fixture
def play():
    return Player()


def test_a_steady_state_keeps_its_rhythm(play):
    assert play(0, "contact").since_ns == 0
    assert play(33, "contact").since_ns == 0
    assert play(66, "contact").pattern == PULSE


def test_two_states_with_the_same_pattern_do_not_restart_it(play):
    play(0, "off_course")
    assert play(50, "also_off").since_ns == 0


def test_an_alarm_starts_at_once(play):
    play(0, "off_course")
    command = play(33, "contact")
    assert (command.pattern, command.since_ns) == (PULSE, 33 * MS)


def test_bursts_play_once_on_entry(play):
    assert play(0, "hit").pattern == SUCCESS
    assert play(290, "hit").pattern == SUCCESS
    assert play(300, "hit").pattern == OFF
    assert play(1000, "hit").pattern == OFF


def test_bursts_continue_in_a_silent_state(play):
    play(0, "hit")
    command = play(100, "on_course")
    assert (command.pattern, command.since_ns) == (SUCCESS, 0)
    assert play(300, "on_course").pattern == OFF


def test_flicker_at_the_threshold_does_not_restart_bursts(play):
    play(0, "hit")
    play(33, "on_course")
    assert play(66, "hit").since_ns == 0


def test_bursts_play_again_when_their_state_is_entered_later(play):
    play(0, "hit")
    play(400, "on_course")
    assert play(500, "hit").since_ns == 500 * MS


@pytest.mark.parametrize(
    ("state", "pattern"), [("contact", PULSE), ("off_course", LOW), (UNKNOWN, OFF), (TIP_NOT_VISIBLE, OFF)]
)
def test_an_alarm_guidance_a_lost_needle_or_a_lost_tip_cut_bursts_short(play, state, pattern):
    play(0, "hit")
    assert play(50, state).pattern == pattern


def test_a_tip_that_is_not_visible_may_have_a_pattern_of_its_own():
    render = GrammarRenderer([OFF, SUCCESS, LOW])
    render(Conclusion(0, "hit", 0, "success", ""))
    assert render(Conclusion(50 * MS, TIP_NOT_VISIBLE, 0, "low", "")).pattern == LOW


def test_after_an_alarm_inside_the_target_bursts_play_again(play):
    play(0, "hit")
    play(50, "contact")
    assert play(90, "hit").pattern == SUCCESS


def test_other_bursts_replace_the_current_ones(play):
    play(0, "hit")
    assert play(50, "bell").pattern == CHIME


def test_reset_ends_the_current_pattern(play):
    play(0, "hit")
    play.render.reset()
    assert play(10, "on_course").pattern == OFF
    assert play(20, "hit").since_ns == 20 * MS


@given(st.lists(st.tuples(st.integers(1, 400), st.sampled_from(sorted(PATTERNS))), max_size=60))
def test_a_silent_or_unknown_state_never_vibrates_except_for_the_end_of_a_burst(sequence):
    play, now_ms, last_burst_ms = Player(), 0, -(10**6)
    for wait_ms, state in sequence:
        now_ms += wait_ms
        command = play(now_ms, state)
        amplitude = amplitude_at(command, now_ms * MS)
        if command.pattern.kind == "bursts" and command.since_ns == now_ms * MS:
            last_burst_ms = now_ms
        if state in (UNKNOWN, TIP_NOT_VISIBLE):
            assert amplitude == 0
        if state == "on_course" and amplitude:
            assert now_ms - last_burst_ms < 300


def test_bursts_play_again_only_after_their_state_was_left_long_enough():
    rare = Pattern("rare", "bursts", amplitude=0.5, on_ms=50, off_ms=50, count=2, rearm_ms=1000)
    render = GrammarRenderer([OFF, rare])

    def play(ms: float, state: str):
        feel = "rare" if state == "hit" else "off"
        return render(Conclusion(round(ms * MS), state, 0, feel, "")).pattern

    assert play(0, "hit") == rare
    assert play(300, "near") == OFF
    assert play(600, "hit") == OFF
    assert play(700, "near") == OFF
    assert play(1500, "hit") == OFF  # left for 900 ms only
    assert play(1600, "near") == OFF
    assert play(2600, "hit") == rare
    render.reset()
    assert play(2700, "hit") == rare


def test_bursts_that_may_not_play_again_yet_end_other_patterns():
    rearmed = replace(SUCCESS, rearm_ms=1000)
    render = GrammarRenderer([OFF, LOW, rearmed])
    render(Conclusion(0, "hit", 0, "success", ""))
    render(Conclusion(400 * MS, "off_course", 0, "low", ""))
    assert render(Conclusion(500 * MS, "hit", 0, "success", "")) == HapticCommand(500 * MS, OFF, 500 * MS)


def test_bursts_play_again_exactly_when_they_are_armed():
    render = GrammarRenderer([OFF, replace(SUCCESS, rearm_ms=1000)])
    render(Conclusion(0, "hit", 0, "success", ""))
    render(Conclusion(400 * MS, "on_course", 0, "off", ""))
    assert render(Conclusion(1000 * MS, "hit", 0, "success", "")).since_ns == 1000 * MS


def test_any_silent_pattern_is_silence():
    render = GrammarRenderer([LOW, Pattern("rest", "off", amplitude=0.5)])
    render(Conclusion(0, "off_course", 0, "low", ""))
    assert render(Conclusion(40 * MS, "on_course", 0, "rest", "")) == HapticCommand(40 * MS, OFF, 40 * MS)


def test_after_a_reset_commands_are_those_of_a_new_run(play):
    play(0, "contact")
    play.render.reset()
    assert play(100, "on_course") == Player()(100, "on_course")


def test_pulses_of_another_name_start_from_their_beginning():
    other = replace(PULSE, name="other", off_ms=200)
    render = GrammarRenderer([PULSE, other])
    render(Conclusion(0, "contact", 0, "pulse", ""))
    assert render(Conclusion(33 * MS, "deep", 0, "other", "")).since_ns == 33 * MS
