import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.study.simulated.belief import ANGLES_DEG, Belief, seen_angle_deg
from haptigraph.study.simulated.participant import TRAITS, Participant, draw_participant
from haptigraph.study.simulated.person import SimulatedPerson
from haptigraph.study.simulated.touch_sense import SenseOfTouch

IMAGE_S = 1 / 30
AXIS_MM = 24.0
BINARY = np.where(np.abs(ANGLES_DEG) > 1.7, 0.3, 0.0)


def test_a_participant_has_every_trait_and_each_has_a_source():
    assert set(Participant.__struct_fields__) == {"number", *TRAITS}
    assert all(trait.source and trait.says and trait.unit for trait in TRAITS.values())


@given(st.integers(0, 2**31), st.integers(0, 2000))
def test_participants_come_from_their_seed_and_are_no_monsters(seed, number):
    who = draw_participant(seed, number)
    assert who == draw_participant(seed, number)
    assert who != draw_participant(seed, number + 1)
    assert all(getattr(who, name) >= 0 for name in TRAITS)
    assert 0.2 < who.sight_s < 0.4 and 0.25 < who.feeling_s < 0.5
    assert 0 <= who.align_share <= 1 and 0 < who.notices_share <= 1


# --- the angle as it is seen and believed


@given(st.floats(-30, 30), st.floats(1, 20))
def test_the_deeper_the_tip_the_larger_the_angle_looks(theta_deg, depth_mm):
    shallow, deep = (
        float(seen_angle_deg(np.array(theta_deg), at, AXIS_MM)) for at in (depth_mm, depth_mm + 2)
    )
    assert abs(theta_deg) <= abs(shallow) + 1e-9 <= abs(deep) + 2e-9
    assert shallow * theta_deg >= 0


def test_looks_make_sure_and_turns_move_what_is_believed():
    belief = Belief(0.01)
    expected = seen_angle_deg(ANGLES_DEG, 5.0, AXIS_MM)
    for _ in range(5):
        belief.look(float(seen_angle_deg(np.array(8.0), 5.0, AXIS_MM)), expected, 1.0)
    assert belief.likeliest_deg() == pytest.approx(8.0, abs=0.4)
    belief.turned(-6.0, 0.1)
    assert belief.likeliest_deg() == pytest.approx(2.0, abs=0.4)


def test_vibration_tells_who_sees_nothing_amiss_that_something_is():
    belief = Belief(2.0)
    expected = seen_angle_deg(ANGLES_DEG, 5.0, AXIS_MM)
    belief.look(0.5, expected, 1.5)
    assert abs(belief.likeliest_deg()) < 1.0
    belief.feel(0.3, BINARY, 0.2)
    assert belief.likeliest_deg() > 1.7
    belief.turned(-belief.likeliest_deg(), 0.1)
    belief.feel(0.3, BINARY, 0.2)  # still: it was the other side, or more
    assert abs(belief.likeliest_deg()) > 1.7


def test_a_strength_tells_how_far():
    belief = Belief(2.0)
    belief.look(0.5, seen_angle_deg(ANGLES_DEG, 5.0, AXIS_MM), 5.0)
    belief.feel(0.4, np.clip(np.abs(ANGLES_DEG) / 20, 0, 1), 0.1)
    assert abs(belief.likeliest_deg()) == pytest.approx(8.0, abs=1.0)


# --- touch


def sense(*changes):
    felt = SenseOfTouch(0.05)
    for time_s, amplitude in changes:
        felt.tell(time_s, amplitude)
    return felt


def train(count, on_s, off_s, amplitude):
    starts = [number * (on_s + off_s) for number in range(count)]
    return [change for start in starts for change in ((start, amplitude), (start + on_s, 0.0))]


def test_steady_vibration_guides_until_it_ends():
    felt = sense((1.0, 0.3), (2.0, 0.45), (3.0, 0.0))
    assert [felt.at(time_s).word for time_s in (0.9, 1.1, 2.9, 3.1)] == [
        "nothing",
        "guidance",
        "guidance",
        "nothing",
    ]
    assert (felt.at(1.5).share, felt.at(2.5).share) == (0.3, 0.45)


def test_slow_pulses_guide_without_a_break():
    felt = sense(*train(8, 0.12, 0.28, 0.3))
    assert {felt.at(time_s).word for time_s in np.arange(0.01, 3.0, 0.05)} == {"guidance"}
    assert felt.at(4.0).word == "nothing"


def test_three_strong_pulses_are_an_alarm_and_two_are_praise():
    alarm, praise = sense(*train(6, 0.08, 0.08, 1.0)), sense(*train(2, 0.1, 0.1, 0.8))
    assert [alarm.at(time_s).word for time_s in (0.05, 0.5)] == ["strong", "alarm"]
    assert [praise.at(time_s).word for time_s in (0.05, 0.25, 0.5)] == ["strong", "strong", "praise"]


def test_what_is_too_faint_is_not_felt():
    assert sense((1.0, 0.04)).at(1.5).word == "nothing"


# --- the person


def steer(person, changes, seconds=6.0, depth_mm=10.0, theta_deg=0.0):
    """Let a person steer a needle that obeys; return depth [mm] and angle [deg] after every image."""
    places = []
    for image in range(1, round(seconds / IMAGE_S)):
        now_s = image * IMAGE_S
        while changes and changes[0][0] <= now_s:
            time_s, amplitude = changes.pop(0)
            person.feel(round(time_s * 1e9), amplitude, 80.0)
        motion = person.act(now_s, IMAGE_S)
        depth_mm, theta_deg = depth_mm + motion.along_mm, theta_deg + motion.turn_deg
        person.see(now_s, depth_mm, theta_deg)
        places.append((depth_mm, theta_deg))
    return np.array(places)


@pytest.fixture
def who():
    return replace(draw_participant(1, 0), notices_share=1.0, align_share=0.0, misjudgement_deg=1e-3)


def test_without_touch_the_needle_goes_to_the_target(who):
    places = steer(
        SimulatedPerson(who, 0 * BINARY, AXIS_MM, (1,)), [], seconds=40, depth_mm=3.0, theta_deg=12.0
    )
    assert places[-1, 0] == pytest.approx(AXIS_MM, abs=0.7)
    assert abs(places[-1, 1]) < 1.7
    assert np.all(np.diff(places[:, 0]) < 3 * who.pace_mm_s * IMAGE_S)


def test_vibration_stops_the_approach_after_a_reaction_time_and_turns_the_needle(who):
    places = steer(SimulatedPerson(who, BINARY, AXIS_MM, (1,)), [(2.0, 0.3)], theta_deg=8.0)
    depth_mm, theta_deg = places.T
    began, answered = round(2.0 / IMAGE_S), round((2.0 + who.feeling_s + 0.1) / IMAGE_S)
    assert depth_mm[answered - 4] > depth_mm[began]  # not before
    assert np.ptp(depth_mm[answered + 2 :]) < 0.01
    assert theta_deg[-1] < theta_deg[answered] - 3


def test_pulses_make_the_hand_draw_back(who):
    pulses = [(2 + time_s, amplitude) for time_s, amplitude in train(5, 0.08, 0.08, 1.0)]
    places = steer(SimulatedPerson(who, BINARY, AXIS_MM, (1,)), pulses, seconds=4.0)
    assert places[:, 0].max() - places[-1, 0] > 0.5 * who.withdraw_mm


def test_a_double_burst_ends_the_work(who):
    bursts = [(2 + time_s, amplitude) for time_s, amplitude in train(2, 0.1, 0.1, 0.8)]
    places = steer(SimulatedPerson(who, BINARY, AXIS_MM, (1,)), bursts, seconds=8.0, theta_deg=5.0)
    assert np.ptp(places[round(4 / IMAGE_S) :], axis=0) == pytest.approx([0, 0])
