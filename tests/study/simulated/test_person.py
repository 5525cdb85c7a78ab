import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import BadInput, RenamedKey
from haptigraph.study.simulated.haptic_perception import HapticPerception
from haptigraph.study.simulated.participant import (
    OLD_TRAITS,
    TRAITS,
    Participant,
    draw_participant,
    trait_name,
)
from haptigraph.study.simulated.person import SimulatedPerson
from haptigraph.study.simulated.posterior import ANGLES_DEG, AnglePosterior, visual_angle_deg

IMAGE_S = 1 / 30
AXIS_MM = 24.0
BINARY = np.where(np.abs(ANGLES_DEG) > 1.7, 0.3, 0.0)


def test_a_participant_has_every_trait_and_each_has_a_source():
    assert set(Participant.__struct_fields__) == {"number", *TRAITS}
    assert all(trait.source and trait.description and trait.unit for trait in TRAITS.values())


def test_traits_are_found_by_the_names_of_earlier_versions():
    assert set(OLD_TRAITS.values()) <= set(TRAITS) and not set(OLD_TRAITS) & set(TRAITS)
    assert trait_name("pace_mm_s", "--vary") == "pace_mm_s"
    message = "--vary: trait 'glance_deviation_deg' is now called 'glance_sd_deg'"
    with pytest.warns(RenamedKey, match=message):
        assert trait_name("glance_deviation_deg", "--vary") == "glance_sd_deg"
    with pytest.raises(BadInput, match="unknown trait 'pace_mm'; did you mean 'pace_mm_s'"):
        trait_name("pace_mm", "--vary")


@given(st.integers(0, 2**31), st.integers(0, 2000))
def test_participants_depend_on_their_seed_only_and_are_plausible(seed, number):
    participant = draw_participant(seed, number)
    assert participant == draw_participant(seed, number)
    assert participant != draw_participant(seed, number + 1)
    assert all(getattr(participant, name) >= 0 for name in TRAITS)
    assert 0.2 < participant.visual_latency_s < 0.4 and 0.25 < participant.haptic_latency_s < 0.5
    assert 0 <= participant.align_share <= 1 and 0 < participant.attention_probability <= 1


# --- the perceived angle


@given(st.floats(-30, 30), st.floats(1, 20))
def test_the_deeper_the_tip_the_larger_the_visual_angle(theta_deg, depth_mm):
    shallow, deep = (
        float(visual_angle_deg(np.array(theta_deg), at, AXIS_MM)) for at in (depth_mm, depth_mm + 2)
    )
    assert abs(theta_deg) <= abs(shallow) + 1e-9 <= abs(deep) + 2e-9
    assert shallow * theta_deg >= 0


def test_visual_cues_narrow_the_posterior_and_turns_shift_it():
    posterior = AnglePosterior(0.01)
    expected = visual_angle_deg(ANGLES_DEG, 5.0, AXIS_MM)
    for _ in range(5):
        posterior.add_visual_cue(float(visual_angle_deg(np.array(8.0), 5.0, AXIS_MM)), expected, 1.0)
    assert posterior.most_probable_deg() == pytest.approx(8.0, abs=0.4)
    posterior.predict(-6.0, 0.1)
    assert posterior.most_probable_deg() == pytest.approx(2.0, abs=0.4)


@given(st.floats(-38, 38), st.floats(0, 0.5))
def test_a_turn_moves_the_posterior_by_its_angle(turn_deg, sd_deg):
    posterior = AnglePosterior(0.01)
    posterior.add_visual_cue(0.0, ANGLES_DEG, 0.5)
    posterior.predict(turn_deg, sd_deg)
    assert posterior.most_probable_deg() == pytest.approx(turn_deg, abs=0.2)


def test_a_haptic_cue_indicates_a_misalignment_that_is_not_visible():
    posterior = AnglePosterior(2.0)
    expected = visual_angle_deg(ANGLES_DEG, 5.0, AXIS_MM)
    posterior.add_visual_cue(0.5, expected, 1.5)
    assert abs(posterior.most_probable_deg()) < 1.0
    posterior.add_haptic_cue(0.3, BINARY, 0.2)
    assert posterior.most_probable_deg() > 1.7
    posterior.predict(-posterior.most_probable_deg(), 0.1)
    posterior.add_haptic_cue(0.3, BINARY, 0.2)  # it was the other side, or a larger angle
    assert abs(posterior.most_probable_deg()) > 1.7


def test_the_amplitude_of_a_haptic_cue_indicates_the_angle():
    posterior = AnglePosterior(2.0)
    posterior.add_visual_cue(0.5, visual_angle_deg(ANGLES_DEG, 5.0, AXIS_MM), 5.0)
    posterior.add_haptic_cue(0.4, np.clip(np.abs(ANGLES_DEG) / 20, 0, 1), 0.1)
    assert abs(posterior.most_probable_deg()) == pytest.approx(8.0, abs=1.0)


# --- haptic perception


def perception(*changes):
    perceived = HapticPerception(0.05)
    for time_s, amplitude in changes:
        perceived.add(time_s, amplitude)
    return perceived


def train(count, on_s, off_s, amplitude):
    starts = [number * (on_s + off_s) for number in range(count)]
    return [change for start in starts for change in ((start, amplitude), (start + on_s, 0.0))]


def test_continuous_vibration_is_guidance_until_it_ends():
    felt = perception((1.0, 0.3), (2.0, 0.45), (3.0, 0.0))
    assert [felt.at(time_s).cue for time_s in (0.9, 1.1, 2.9, 3.1)] == [
        "none",
        "guidance",
        "guidance",
        "none",
    ]
    assert (felt.at(1.5).amplitude, felt.at(2.5).amplitude) == (0.3, 0.45)
    felt.add(4.0, 0.3)
    assert [felt.at(time_s).cue for time_s in (4.1, 2.9)] == ["guidance", "guidance"]


def test_slow_pulses_are_uninterrupted_guidance():
    felt = perception(*train(8, 0.12, 0.28, 0.3))
    assert {felt.at(time_s).cue for time_s in np.arange(0.01, 3.0, 0.05)} == {"guidance"}
    assert felt.at(4.0).cue == "none"


def test_three_strong_pulses_are_an_alarm_and_two_are_success():
    alarm, success = perception(*train(6, 0.08, 0.08, 1.0)), perception(*train(2, 0.1, 0.1, 0.8))
    assert [alarm.at(time_s).cue for time_s in (0.05, 0.5)] == ["strong", "alarm"]
    assert [success.at(time_s).cue for time_s in (0.05, 0.25, 0.5)] == ["strong", "strong", "success"]


def test_amplitudes_below_the_absolute_threshold_are_not_felt():
    assert perception((1.0, 0.04)).at(1.5).cue == "none"


# --- the person


def steer(person, changes, seconds=6.0, depth_mm=10.0, theta_deg=0.0):
    """Let a person steer an ideal needle; return depth [mm] and angle [deg] after every image."""
    poses = []
    for image in range(1, round(seconds / IMAGE_S)):
        now_s = image * IMAGE_S
        while changes and changes[0][0] <= now_s:
            time_s, amplitude = changes.pop(0)
            person.add_output(round(time_s * 1e9), amplitude, 80.0)
        motion = person.move(now_s, IMAGE_S)
        depth_mm, theta_deg = depth_mm + motion.along_mm, theta_deg + motion.turn_deg
        person.add_screen(now_s, depth_mm, theta_deg)
        poses.append((depth_mm, theta_deg))
    return np.array(poses)


@pytest.fixture
def participant():
    return replace(
        draw_participant(1, 0), attention_probability=1.0, align_share=0.0, visual_bias_sd_deg=1e-3
    )


def test_without_haptics_the_needle_reaches_the_target(participant):
    person = SimulatedPerson(participant, 0 * BINARY, AXIS_MM, (1,))
    poses = steer(person, [], seconds=40, depth_mm=3.0, theta_deg=12.0)
    assert poses[-1, 0] == pytest.approx(AXIS_MM, abs=0.7)
    assert abs(poses[-1, 1]) < 1.7
    assert np.all(np.diff(poses[:, 0]) < 3 * participant.pace_mm_s * IMAGE_S)


def test_vibration_stops_the_approach_after_a_reaction_time_and_turns_the_needle(participant):
    poses = steer(SimulatedPerson(participant, BINARY, AXIS_MM, (1,)), [(2.0, 0.3)], theta_deg=8.0)
    depth_mm, theta_deg = poses.T
    onset, response = round(2.0 / IMAGE_S), round((2.0 + participant.haptic_latency_s + 0.1) / IMAGE_S)
    assert depth_mm[response - 4] > depth_mm[onset]  # no earlier
    assert np.ptp(depth_mm[response + 2 :]) < 0.01
    assert theta_deg[-1] < theta_deg[response] - 3


def test_pulses_make_the_hand_withdraw(participant):
    pulses = [(2 + time_s, amplitude) for time_s, amplitude in train(5, 0.08, 0.08, 1.0)]
    poses = steer(SimulatedPerson(participant, BINARY, AXIS_MM, (1,)), pulses, seconds=4.0)
    assert poses[:, 0].max() - poses[-1, 0] > 0.5 * participant.withdraw_mm


def test_a_double_burst_ends_the_movement(participant):
    bursts = [(2 + time_s, amplitude) for time_s, amplitude in train(2, 0.1, 0.1, 0.8)]
    poses = steer(SimulatedPerson(participant, BINARY, AXIS_MM, (1,)), bursts, seconds=8.0, theta_deg=5.0)
    assert np.ptp(poses[round(4 / IMAGE_S) :], axis=0) == pytest.approx([0, 0])
