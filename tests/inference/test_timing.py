"""States that must last to be entered, and holds that may delay alarms."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.errors import BadInput
from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.engine import RuleEngine
from haptigraph.proof.prove import prove

PAPER = load_procedure("subretinal_injection")
MISALIGNED, ALIGNED = "misaligned_intraocular_navigation", "aligned_intraocular_navigation"


def with_state(name, **changes):
    states = tuple(replace(one, **changes) if one.name == name else one for one in PAPER.states)
    return replace(PAPER, states=states)


def scene(stamp_ms, *edges):
    nodes = tuple(Node(entity.name, entity.name, entity.group) for entity in PAPER.schema.entities)
    triplets = tuple(Triplet(*one.names) for one in PAPER.schema.relations if one.predicate in edges)
    return SceneGraph(stamp_ns=stamp_ms * 1_000_000, nodes=nodes, edges=triplets)


def inside(stamp_ms, direction):
    graph = scene(stamp_ms, "inside", direction)
    return replace(graph, edges=tuple(one for one in graph.edges if one.predicate in ("inside", direction)))


def states_of(procedure, *graphs):
    engine = RuleEngine(procedure)
    return [engine(graph).state for graph in graphs]


def test_a_state_begins_when_its_rule_has_fitted_for_long_enough():
    procedure = with_state(ALIGNED, enter_after_ms=100.0)
    procedure = replace(
        procedure, states=(*procedure.states, replace(PAPER.states[-1], name="late", when=()))
    )
    graphs = [inside(stamp_ms, "aligned") for stamp_ms in (0, 50, 99, 100, 150)]
    assert states_of(procedure, *graphs) == ["late", "late", "late", ALIGNED, ALIGNED]


def test_an_interruption_starts_the_time_anew():
    procedure = with_state(ALIGNED, enter_after_ms=100.0)
    graphs = [inside(0, "aligned"), inside(90, "misaligned"), inside(100, "aligned"), inside(200, "aligned")]
    assert states_of(procedure, *graphs) == ["unknown", MISALIGNED, "unknown", ALIGNED]


def test_a_reset_starts_the_time_anew():
    engine = RuleEngine(with_state(ALIGNED, enter_after_ms=100.0))
    engine(inside(0, "aligned"))
    engine.reset()
    assert engine(inside(150, "aligned")).state == "unknown"


@given(st.lists(st.tuples(st.integers(1, 200), st.sampled_from(["aligned", "misaligned"])), max_size=30))
def test_an_alarm_is_never_later_than_without_waiting(images):
    """Waiting reveals later rules only, so what an alarm's graphs conclude does not change."""
    procedure = with_state(MISALIGNED, enter_after_ms=150.0)
    stamp_ms, graphs = 0, []
    for step_ms, direction in images:
        stamp_ms += step_ms
        touching = Triplet("needle_tip", "touching", "retina_surface")
        graphs.append(replace(inside(stamp_ms, direction), edges=(touching,)))
    assert states_of(procedure, *graphs) == ["retinal_contact"] * len(graphs)


def test_while_a_state_waits_another_rule_must_fit():
    (claim,) = [
        one for one in prove(with_state(ALIGNED, enter_after_ms=100.0)).claims if one.name == "waiting"
    ]
    (violation,) = claim.violations
    assert "meanwhile no other rule fits here" in violation.sentence
    assert violation.state == ALIGNED


@pytest.mark.parametrize("prover", ["exhaustive", "z3"])
def test_invariants_name_the_states_that_break_them_while_they_wait(prover):
    approach = "misaligned_retinal_approach"
    proof = prove(with_state(approach, enter_after_ms=100.0), prover)
    assert proof.holds
    waiting = {claim.statement: claim.not_while_waiting for claim in proof.claims if claim.not_while_waiting}
    assert waiting == {"near the retina the approach comes first, misaligned": (approach,)}


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('feel = "pulse"', 'feel = "pulse"\nenter_after_ms = 50', "an alarm never waits"),
        (
            'feel = "off"\nbecause = "no',
            'feel = "off"\nenter_after_ms = 50\nbecause = "no',
            "the loss of what is detected",
        ),
        (
            'feel = "success"',
            'feel = "success"\nmay_delay = ["retinal_contact"]',
            "has may_delay without hold_ms",
        ),
        (
            'feel = "success"',
            'feel = "success"\nhold_ms = 50\nmay_delay = ["outside_eye"]',
            "unknown alarm 'outside_eye'",
        ),
        ('feel = "success"', 'feel = "success"\nenter_after_ms = -1', "enter_after_ms"),
    ],
)
def test_what_may_not_wait_is_refused(old, new, problem):
    assert old in PAPER.text
    with pytest.raises(BadInput, match=problem):
        parse_procedure(PAPER.text.replace(old, new, 1), "p.toml")


def swapped():
    """The paper's procedure with the target before the alarm, so that a hold could delay the alarm."""
    alarm, target = PAPER.states[2:4]
    return (*PAPER.states[:2], replace(target, hold_ms=300.0), alarm, *PAPER.states[4:])


def test_a_declared_delay_is_no_violation_and_is_repeated():
    states = swapped()
    procedure = replace(PAPER, states=states, temporal=())
    (claim,) = [one for one in prove(procedure).claims if one.name == "prompt"]
    assert "which delays retinal_contact" in claim.violations[0].sentence
    declared = replace(states[2], may_delay=("retinal_contact",))
    proof = prove(replace(procedure, states=(*states[:2], declared, *states[3:])))
    assert proof.holds
    assert (
        "up to 300 ms in which target_hit is held and retinal_contact waits, as declared" in proof.uncovered
    )


def test_a_held_alarm_delays_nothing():
    assert prove(load_procedure("subretinal_injection_steady")).holds
