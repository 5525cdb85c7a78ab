from itertools import chain, combinations

import pytest
from helpers import MS, mostly_slow
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.geometry import Circle, Point, Polyline, Segment
from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN, Certainty, Conclusion, Observation
from haptigraph.proof.space import Space
from haptigraph.scene.builder import SchemaSceneBuilder


def subsets(items):
    return chain.from_iterable(combinations(items, size) for size in range(len(items) + 1))


def every_graph(procedure: Procedure):
    """All graphs that the schema allows: any nodes, any relations between nodes that are present."""
    schema = procedure.schema
    for entities in subsets(schema.entities):
        names = {entity.name for entity in entities}
        nodes = tuple(Node(entity.name, entity.name, entity.group) for entity in entities)
        possible = [
            Triplet(*relation.names)
            for relation in schema.relations
            if {relation.subject, relation.object} <= names
        ]
        for edges in subsets(possible):
            yield SceneGraph(0, nodes, tuple(edges))


def expected_state(procedure: Procedure, graph: SceneGraph) -> str:
    """The state by a direct reading of the rules, top to bottom."""
    present = {node.category for node in graph.nodes}
    holding = {(edge.subject, edge.predicate, edge.object) for edge in graph.edges}
    for state in procedure.states:
        required = all(names in holding for names in state.when)
        forbidden = any(names in holding for names in state.unless)
        if required and not forbidden and not any(name in present for name in state.absent):
            return state.name
    return UNKNOWN


@pytest.mark.parametrize("name", mostly_slow(procedure_names(), "subretinal_injection", "vein_cannulation"))
def test_the_engine_agrees_with_a_direct_reading_of_the_rules_on_every_possible_graph(name):
    procedure = load_procedure(name)
    engine = RuleEngine(procedure)
    graphs = 0
    for graph in every_graph(procedure):
        engine.reset()
        assert engine(graph).state == expected_state(procedure, graph)
        graphs += 1
    assert graphs > 1000


def graph_of(*edges: tuple[str, str, str], **measures: float) -> SceneGraph:
    names = {"needle_tip", "needle_line", "retina_surface", "retina_target", "eye_globe", "trocar"}
    nodes = tuple(Node(name, name, "any") for name in sorted(names))
    return SceneGraph(42, nodes, tuple(Triplet(*edge) for edge in edges), measures)


TOUCH = ("needle_tip", "touching", "retina_surface")
HIT = ("needle_tip", "touching", "retina_target")
NEAR = ("needle_tip", "approaching", "retina_surface")
INSIDE = ("needle_tip", "inside", "eye_globe")
OUTSIDE = ("needle_tip", "outside", "eye_globe")
ALIGNED = ("needle_line", "aligned", "retina_target")
OFF = ("needle_line", "misaligned", "retina_target")


@pytest.mark.parametrize(
    ("edges", "state", "feel"),
    [
        ((TOUCH, INSIDE, OFF), "retinal_contact", "pulse"),
        ((TOUCH, OUTSIDE, ALIGNED), "retinal_contact", "pulse"),
        ((TOUCH, HIT, INSIDE, ALIGNED), "target_hit", "success"),
        ((NEAR, INSIDE, OFF), "misaligned_retinal_approach", "low"),
        ((NEAR, INSIDE, ALIGNED), "aligned_retinal_approach", "off"),
        ((INSIDE, OFF), "misaligned_intraocular_navigation", "low"),
        ((INSIDE, ALIGNED), "aligned_intraocular_navigation", "off"),
        ((OUTSIDE, OFF), "outside_eye", "off"),
        ((), UNKNOWN, "off"),
    ],
)
def test_the_papers_states_and_patterns(procedure, edges, state, feel):
    conclusion = RuleEngine(procedure)(graph_of(*edges))
    assert (conclusion.state, conclusion.feel) == (state, feel)


def test_without_a_needle_the_state_is_unknown_whatever_else_is_present(procedure):
    nodes = (Node("eye_globe", "eye_globe", "anatomy"),)
    conclusion = RuleEngine(procedure)(SceneGraph(1, nodes))
    assert (conclusion.state, conclusion.priority) == (UNKNOWN, 0)
    assert conclusion.because == "no needle is seen"


@pytest.mark.parametrize("name", procedure_names())
def test_an_instrument_without_a_tip_is_not_unknown_in_any_shipped_procedure(name):
    """Whatever else is present: the state says that the instrument is seen, and no alarm or guidance is felt.

    The one exception is a tip that was moving towards the RPE.
    """
    shipped = load_procedure(name)
    tip, line = (
        f"{'forceps' if name == 'membrane_peeling' else 'needle'}_{part}" for part in ("tip", "line")
    )
    space, reason = Space(shipped.schema), RuleEngine(shipped)
    graphs = [space.graph(world) for world in space.worlds()]
    without_tip = [graph for graph in graphs if tip not in {node.id for node in graph.nodes}]
    seen = {state: set() for state in (UNKNOWN, TIP_NOT_VISIBLE)}
    for graph in without_tip:
        conclusion = reason(graph)
        if "needle_tip_ahead" in {edge.subject for edge in graph.edges}:
            assert (name, conclusion.state) == ("subretinal_injection_4d", "reaching_rpe")
            continue
        seen[conclusion.state].add(line in {node.id for node in graph.nodes})
        assert conclusion.feel in ("off", "tick")
    assert seen == {UNKNOWN: {False}, TIP_NOT_VISIBLE: {True}}


def test_the_tick_of_a_tip_that_is_not_visible_is_much_weaker_than_guidance_and_alarm():
    steady = load_procedure("subretinal_injection_steady")
    patterns = {pattern.name: pattern for pattern in steady.patterns}
    tick, low, pulse = patterns["tick"], patterns["low"], patterns["pulse"]
    assert tick.amplitude <= 0.7 * low.amplitude < pulse.amplitude
    assert tick.on_ms + tick.off_ms == 1000
    assert tick.on_ms >= 50  # motors need it to spin up


def test_a_conclusion_gives_the_rule_and_the_reason(procedure):
    conclusion = RuleEngine(procedure)(graph_of(TOUCH, INSIDE, OFF, distance_to_target_mm=2.345))
    assert conclusion.stamp_ns == 42
    assert conclusion.priority == 2
    assert conclusion.evidence == (Triplet(*TOUCH),)
    assert conclusion.because == "the tip touches the retina 2.3 mm from the target"


def test_a_missing_measure_is_a_question_mark_in_the_sentence(procedure):
    assert "? mm from the target" in RuleEngine(procedure)(graph_of(TOUCH)).because


def test_rules_refer_to_categories_not_to_node_ids(procedure):
    nodes = (Node("needle_tip/2", "needle_tip", "instrument"), Node("globe", "eye_globe", "anatomy"))
    graph = SceneGraph(0, nodes, (Triplet("needle_tip/2", "outside", "globe"),))
    assert RuleEngine(procedure)(graph).state == "outside_eye"


def test_edges_that_are_not_in_the_schema_are_ignored(procedure):
    extra = ("needle_tip", "glows_at", "eye_globe")
    assert RuleEngine(procedure)(graph_of(extra, OUTSIDE)).state == "outside_eye"


HELD = {"target_hit": 200, "misaligned_intraocular_navigation": 100}


@pytest.fixture
def holding(procedure) -> RuleEngine:
    states = tuple(replace(state, hold_ms=HELD.get(state.name, 0)) for state in procedure.states)
    return RuleEngine(replace(procedure, states=states))


def states_of(engine: RuleEngine, *graphs) -> list[str]:
    """The states inferred from graphs (ms, edge, ...)."""
    return [engine(replace(graph_of(*edges), stamp_ns=ms * MS)).state for ms, *edges in graphs]


def test_a_state_is_held_for_hold_ms_after_its_rule_last_matched(holding):
    graphs = [(0, INSIDE, OFF), (50, INSIDE, OFF), (149, INSIDE, ALIGNED), (150, INSIDE, ALIGNED)]
    off, on = "misaligned_intraocular_navigation", "aligned_intraocular_navigation"
    assert states_of(holding, *graphs) == [off, off, off, on]


def test_a_held_state_does_not_delay_an_alarm(holding):
    hit, contact = (TOUCH, HIT, INSIDE, ALIGNED), (TOUCH, INSIDE, ALIGNED)
    assert states_of(holding, (0, *hit), (33, *contact)) == ["target_hit", "retinal_contact"]


def test_a_lost_needle_is_unknown_at_once_and_ends_the_hold(holding):
    assert states_of(holding, (0, INSIDE, OFF)) == ["misaligned_intraocular_navigation"]
    assert holding(SceneGraph(33 * MS, ())).state == UNKNOWN
    assert states_of(holding, (66, INSIDE, ALIGNED)) == ["aligned_intraocular_navigation"]


def test_a_state_is_not_held_when_no_rule_matches(holding):
    assert states_of(holding, (0, INSIDE, OFF), (33,)) == ["misaligned_intraocular_navigation", UNKNOWN]


def test_a_held_state_gives_the_time_since_its_rule_last_matched(holding):
    states_of(holding, (0, INSIDE, OFF))
    held = holding(replace(graph_of(INSIDE, ALIGNED), stamp_ns=66 * MS))
    assert held.because.startswith("held; 66 ms ago the needle is in the eye and")
    assert held.evidence == ()


def test_reset_ends_the_hold(holding):
    states_of(holding, (0, INSIDE, OFF))
    holding.reset()
    assert states_of(holding, (33, INSIDE, ALIGNED)) == ["aligned_intraocular_navigation"]


def test_a_conclusion_contains_the_measures_that_its_pattern_follows():
    engine = RuleEngine(load_procedure("subretinal_injection_continuous"))
    near = engine(graph_of(NEAR, INSIDE, OFF, theta_deg=4.0, distance_to_retina_mm=3.0, wall_mm=2.0))
    assert near.measures == {"theta_deg": 4.0, "distance_to_retina_mm": 3.0}
    assert engine(graph_of(NEAR, INSIDE, ALIGNED, theta_deg=1.0)).measures == {}


def test_a_scene_that_no_rule_fits_is_unknown_and_says_so(procedure):
    procedure = replace(procedure, states=tuple(state for state in procedure.states if not state.when))
    conclusion = RuleEngine(procedure)(graph_of(TOUCH))
    assert conclusion == Conclusion(
        42, UNKNOWN, len(procedure.states), "off", "no rule of the procedure fits this scene"
    )


def test_nodes_of_a_category_that_is_not_in_the_schema_are_ignored(procedure):
    graph = graph_of(OUTSIDE)
    foreign = replace(graph, nodes=(*graph.nodes, Node("lens", "lens", "anatomy")))
    assert RuleEngine(procedure)(foreign) == RuleEngine(procedure)(graph)
    nothing = replace(graph, edges=())
    foreign = replace(foreign, edges=())
    assert RuleEngine(procedure)(foreign) == RuleEngine(procedure)(nothing)


def test_a_held_state_has_the_stamp_and_the_measures_of_the_present_graph():
    procedure = load_procedure("subretinal_injection_continuous")
    states = tuple(
        replace(state, hold_ms=100) if state.name == "misaligned_retinal_approach" else state
        for state in procedure.states
    )
    engine = RuleEngine(replace(procedure, states=states))
    engine(graph_of(NEAR, INSIDE, OFF, theta_deg=5.0))
    held = engine(replace(graph_of(NEAR, INSIDE, ALIGNED, theta_deg=1.0), stamp_ns=42 + 50 * MS))
    assert (held.state, held.stamp_ns) == ("misaligned_retinal_approach", 42 + 50 * MS)
    assert held.measures == {"theta_deg": 1.0}


def test_a_state_without_a_hold_ends_even_within_one_stamp(holding):
    engine = holding
    assert states_of(engine, (0, TOUCH, INSIDE), (0, OUTSIDE)) == ["retinal_contact", "outside_eye"]


def test_a_standard_deviation_that_is_unknown_is_named():
    procedure = load_procedure("subretinal_injection_cautious")
    found = {
        "retina_surface": Polyline(((-11.0, -4.0), (11.0, -4.0))),
        "retina_target": Point((5.0, -4.0)),
        "trocar": Point((8.0, 8.0)),
        "eye_globe": Circle((0.0, 0.0), 12.0),
        "needle_tip": Point((0.0, 4.0)),
        "needle_line": Segment((8.0, 8.0), (0.0, 4.0)),
    }
    build, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(procedure)
    because = reason(build(Observation(0, found))).because
    assert because.startswith(
        "the tip may touch the retina away from the target: it is 8.00 mm from the retina"
    )
    assert because.endswith(
        "it cannot be excluded: the standard deviation of distance_to_retina_mm, radial_mm is unknown"
    )
    known = reason(build(Observation(1, found, certainty=Certainty(1.0, 0.05, 0.1))))
    assert "unknown" not in known.because
