"""The whole system against the simulator's ground truth, with small images."""

import math

import pytest
from helpers import observe

from haptigraph.assemble import build
from haptigraph.config import load_config
from haptigraph.graph import Triplet
from haptigraph.inference.engine import RuleEngine
from haptigraph.scene.builder import SchemaSceneBuilder


class RecordingSink:
    dropped = 0

    def __init__(self):
        self.pairs = []

    def write(self, capture, step):
        if capture.image is not None:
            self.pairs.append((capture.truth, step))

    def take_faults(self):
        return ()

    def close(self):
        pass


@pytest.fixture(scope="module", params=["threshold", "tracker"])
def pairs(request, quick_uri):
    sink = RecordingSink()
    settings = (
        f"source.uri={quick_uri}",
        "run.realtime=false",
        f"perception.perceiver={request.param}",
        "perception.alpha=1",
    )
    build(load_config(None, settings), sinks=[sink]).run()
    return sink.pairs


@pytest.fixture(scope="module")
def true_states(pairs, quick_uri, procedure):
    """The states that the same rules give for the true needle."""
    from haptigraph.registration.loading import parse_registration
    from haptigraph.sources.phantom import PhantomSource

    text = PhantomSource(quick_uri.partition(":")[2]).registration
    anatomy = parse_registration(text, "quick").anatomy
    scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(procedure)
    return [
        reason(scene(observe(anatomy, truth.tip_mm))).state if truth.visible else None for truth, _ in pairs
    ]


def test_a_needle_well_inside_is_always_detected(pairs):
    deep = [step for truth, step in pairs if truth.visible and truth.inside and truth.depth_mm > 3]
    assert len(deep) > 80
    assert all("needle_tip" in step.observation.found for step in deep)


def test_a_needle_outside_is_never_reported_inside(pairs):
    outside = [step for truth, step in pairs if not truth.inside]
    assert outside
    assert not any(Triplet("needle_tip", "inside", "eye_globe") in step.graph for step in outside)


def test_tip_and_angle_are_accurate(pairs):
    for truth, step in pairs:
        if truth.visible and truth.inside and truth.depth_mm > 5:
            tip = step.observation.found["needle_tip"]
            assert math.dist(tip.at_mm, truth.tip_mm) < 0.25
            assert abs(step.graph.measures["theta_deg"] - truth.theta_deg) < 1.0


def test_states_agree_with_the_ground_truth_except_at_transitions(pairs, true_states):
    counted = agreed = 0
    for row in range(1, len(pairs) - 1):
        around = set(true_states[row - 1 : row + 2])
        truth, step = pairs[row]
        if len(around) == 1 and truth.visible and truth.inside and truth.depth_mm > 3:
            counted += 1
            agreed += step.conclusion.state == true_states[row]
    assert counted > 70
    assert agreed >= 0.97 * counted


def test_haptic_patterns_follow_the_script(pairs):
    felt = []
    for _, step in pairs:
        if not felt or felt[-1] != step.command.pattern.name:
            felt.append(step.command.pattern.name)
    assert felt == ["off", "low", "pulse", "low", "off", "success", "off"]


def test_the_alarm_coincides_with_contact(pairs, true_states):
    for row in range(1, len(pairs) - 1):
        nearby = set(true_states[row - 1 : row + 2])
        alarmed = pairs[row][1].command.pattern.name == "pulse"
        if alarmed:
            assert nearby & {"retinal_contact", None}
        if nearby == {"retinal_contact"}:
            assert alarmed
