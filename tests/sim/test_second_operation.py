"""Membrane peeling and injection with phases, end to end: the haptic output matches the ground truth."""

from itertools import groupby, pairwise

import pytest
from helpers import graph_on_target
from paths import GOLDEN

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.summary import summary
from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.geometry import Polyline
from haptigraph.inference.engine import RuleEngine
from haptigraph.messages import Observation
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration
from haptigraph.scene.builder import SchemaSceneBuilder


def records(name):
    reader = RunReader(GOLDEN / f"{name}.mcap")
    return reader, [(c, s) for c, s in reader.records(images=()) if c.truth is not None]


def state_order(steps):
    """The states in order, without those that last for a single image."""
    states = [step.conclusion.state for step in steps]
    lasting = [one for one, next_ in pairwise(states) if one == next_]
    return [state for at, state in enumerate(lasting) if at == 0 or lasting[at - 1] != state]


def test_peeling_goes_through_its_states_in_order():
    _, pairs = records("membrane_peeling")
    expected = ("over_hemorrhage", "retinal_contact", "grasped", "peeling", "tool_collision")
    states = state_order(step for _, step in pairs)
    found = [state for state, _ in groupby(state for state in states if state in expected)]
    assert found == [*expected, "peeling"]  # the tip over blood may not be visible for a moment
    assert states[0] == "unknown"
    assert states[-1] == "navigation"


def test_a_peeling_run_is_measured_from_entry_to_the_first_lifting():
    _, pairs = records("membrane_peeling")
    measures = RunMeasures.under(load_procedure("membrane_peeling"))
    for _, step in pairs:
        measures.add(step)
    assert "run             peeling after " in summary(measures)
    assert measures.order[-2:] == ["grasped", "peeling"]
    assert measures.contacts == 1


def test_states_agree_with_the_ground_truth():
    reader, pairs = records("membrane_peeling")
    procedure = parse_procedure(reader.info.procedure, "run")
    scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(procedure)
    anatomy = parse_registration(reader.info.registration, "run").anatomy
    true_states = []
    for capture, _ in pairs:
        found = anatomy | capture.truth.others
        jaws = tuple(found[name].at_mm for name in ("left_jaw", "forceps_tip", "right_jaw"))
        observation = Observation(capture.stamp_ns, found | {"forceps_jaws": Polyline(jaws)})
        true_states.append(reason(scene(observation)).state)
    counted = agreed = 0
    for at in range(1, len(pairs) - 1):
        if len(set(true_states[at - 1 : at + 2])) == 1 and pairs[at][0].truth.depth_mm > 4:
            counted += 1
            agreed += pairs[at][1].conclusion.state == true_states[at]
    assert counted > 60
    assert agreed >= 0.95 * counted
    assert {"retinal_contact", "tool_collision", "over_hemorrhage", "grasped", "peeling"} <= set(true_states)


def test_the_pull_increases_with_the_height_of_the_edge():
    _, pairs = records("membrane_peeling")
    pulls = [
        (step.graph.measures["lift_mm"], step.command.pattern.amplitude)
        for _, step in pairs
        if step.command.pattern.name == "pull" and "lift_mm" in step.graph.measures
    ]
    low, high = min(pulls), max(pulls)
    assert high[0] - low[0] > 2
    assert high[1] > low[1] + 0.2


@pytest.mark.parametrize(
    ("phase", "state", "feel"),
    [
        ("insertion", "early_contact", "pulse"),
        ("approach", "target_hit", "success"),
        ("injection", "injecting", "depth"),
        ("withdrawal", "leaving_target", "off"),
        (None, "retinal_contact", "pulse"),
    ],
)
def test_the_state_of_the_same_contact_depends_on_the_phase(registration, phase, state, feel):
    procedure = load_procedure("subretinal_injection_phases")
    graph = graph_on_target(procedure, registration, phase)
    conclusion = RuleEngine(procedure)(graph)
    assert (conclusion.state, conclusion.feel) == (state, feel)
    assert [node.id for node in graph.nodes if node.group == "phase"] == ([phase] if phase else [])


def test_phases_are_recorded_and_depth_below_the_surface_triggers_pulses():
    _, pairs = records("injection_with_phases")
    order = list(dict.fromkeys(capture.phase for capture, _ in pairs if capture.phase))
    assert order == ["insertion", "approach", "injection", "withdrawal"]
    for capture, step in pairs:
        assert capture.phase in {node.id for node in step.graph.nodes}
    deep = [step for _, step in pairs if step.graph.measures.get("distance_to_retina_mm", 0) < -0.7]
    assert deep
    assert all(step.command.pattern.name == "pulse" for step in deep)
