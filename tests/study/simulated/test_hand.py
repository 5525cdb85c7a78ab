import pytest
from helpers import make_step
from msgspec.structs import replace
from touch_trials import play_trial

from haptigraph.geometry import Point, Polyline
from haptigraph.messages import ForceField, Observation
from haptigraph.study.simulated.hand import PushedHand
from haptigraph.study.simulated.participant import draw_participant
from haptigraph.study.simulated.rehearsal import FORCES

IMAGE_S = 1 / 30
SCALE = 0.2
FLOOR = ForceField("floor", "plane", stiffness_n_per_mm=0.2, limit_n=3.0)


@pytest.fixture
def participant():
    return draw_participant(77, 0)


@pytest.fixture
def hand(participant):
    return PushedHand(participant, SCALE)


def step_at(tip_mm, forces=(FLOOR,)):
    """A step with a needle above a retina at y = 0."""
    found = {
        "needle_tip": Point(tip_mm),
        "retina_surface": Polyline(((-12.0, 0.0), (12.0, 0.0))),
        "trocar": Point((0.0, 20.0)),
    }
    step = make_step()
    return replace(
        step, observation=Observation(0, found), command=replace(step.command, forces=tuple(forces))
    )


def push(hand, forces):
    """Move 0.4 mm of the tool down, in a second, from 0.2 mm above the floor, then hold for a second."""
    tip_mm = 0.2
    for index in range(60):
        hand.take(step_at((0.0, tip_mm), forces))
        moved_mm = hand.move((0.0, -0.4 / SCALE / 30 if index < 30 else 0.0), IMAGE_S)
        assert moved_mm[0] == pytest.approx(0, abs=1e-9)
        tip_mm += SCALE * moved_mm[1]
    return tip_mm


def test_without_force_the_hand_moves_as_intended(hand):
    assert push(hand, ()) == pytest.approx(-0.2)
    assert hand.mean_force_n(0, 2_000_000_000) == 0


def test_a_wall_holds_the_hand_where_both_springs_are_in_balance(hand, participant):
    tip_mm = push(hand, (FLOOR,))
    arm = participant.hand_stiffness_n_per_mm
    deep_mm = 0.2 / SCALE * arm / (arm + FLOOR.stiffness_n_per_mm)  # of the hand, beyond the floor
    assert tip_mm == pytest.approx(-SCALE * deep_mm, rel=0.05)
    last_ns = 1_900_000_000, 2_000_000_000
    assert hand.mean_force_n(*last_ns) == pytest.approx(deep_mm * FLOOR.stiffness_n_per_mm, rel=0.05)


def test_a_hand_that_nothing_holds_returns_to_where_it_intends_to_be(hand):
    push(hand, (FLOOR,))
    moved_mm = 0.0
    for _ in range(60):
        hand.take(step_at((0.0, 1.0), ()))
        moved_mm += hand.move((0.0, 0.0), IMAGE_S)[1]
    assert moved_mm < -0.1
    assert push(hand, ()) == pytest.approx(-0.2, abs=1e-4)


def test_forces_alone_lower_theta_and_do_not_vibrate(participant):
    free, _, forced, _ = (
        play_trial(participant, condition, 0, 77) if condition.name in ("no touch", "force") else None
        for condition in FORCES
    )
    assert free.hit and forced.hit
    assert forced.theta_deg < free.theta_deg
    assert forced.force_n > 0 == free.force_n == forced.vibrating_s
