"""The smallest change to another state, verified by applying it."""

from itertools import product

from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.assemble import load_procedure
from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.engine import RuleEngine
from haptigraph.proof.nearest import Nearest

PROCEDURE = load_procedure("subretinal_injection")
SCHEMA = PROCEDURE.schema
NEAREST = Nearest(PROCEDURE)


def graph_at(measures: dict[str, float], held: SceneGraph | None = None, schema=SCHEMA) -> SceneGraph:
    """The graph for given measures, as the builder would make it."""
    nodes = tuple(Node(one.name, one.name, one.group) for one in schema.entities)
    before = {(edge.subject, edge.predicate, edge.object) for edge in held.edges} if held else set()
    edges: list[tuple[str, str, str]] = []
    for relation in schema.relations:
        value = measures[schema.measure_name(relation)]
        if relation.holds(value, held=relation.names in before) and all(
            one in edges for one in relation.given
        ):
            edges.append(relation.names)
    return SceneGraph(0, nodes, tuple(Triplet(*names) for names in edges), measures)


def measured(retina=8.0, radial=3.0, target=9.0, theta=5.0, wall=3.0) -> dict[str, float]:
    return {
        "distance_to_retina_mm": retina,
        "radial_mm": radial,
        "distance_to_target_mm": target,
        "theta_deg": theta,
        "wall_mm": wall,
    }


def changes(graph: SceneGraph):
    return {change.state: change for change in NEAREST.changes(NEAREST.mask(graph), graph.measures)}


def test_near_the_retina_contact_is_a_millimetre_away_and_alignment_a_few_degrees():
    graph = graph_at(measured(retina=1.7, theta=6.3))
    near = changes(graph)
    assert next(iter(near)) == "retinal_contact"
    (contact,) = near["retinal_contact"].moves
    assert (contact.measure, contact.to) == ("distance_to_retina_mm", "distance_to_retina_mm <= 0.7")
    assert round(contact.way, 6) == -1.0
    (aligned,) = near["aligned_retinal_approach"].moves
    assert (aligned.to, round(aligned.way, 6)) == ("theta_deg <= 1.7", -4.6)
    assert near["aligned_retinal_approach"].appear == ("<needle_line, aligned, retina_target>",)
    assert near["aligned_retinal_approach"].vanish == ("<needle_line, misaligned, retina_target>",)
    assert near["misaligned_intraocular_navigation"].fits_already
    assert near["unknown"].vanish[-2:] == ("needle_tip", "needle_line")


def test_without_a_needle_only_relevant_measures_are_listed():
    fixed = tuple(Node(one.name, one.name, one.group) for one in SCHEMA.entities if one.fixed)
    for graph in (SceneGraph(0, fixed), SceneGraph(0)):
        contact = changes(graph)["retinal_contact"]
        assert [move.to for move in contact.moves] == ["distance_to_retina_mm <= 0.7", "radial_mm > 0.7"]
        assert all(move.value is None and move.way is None for move in contact.moves)


def test_a_relation_ends_at_its_release_and_begins_at_its_bound():
    relations = [
        replace(one, release=5.8) if one.names[1:] == ("approaching", "retina_surface") else one
        for one in SCHEMA.relations
    ]
    schema = replace(SCHEMA, relations=tuple(relations))
    nearest = Nearest(replace(PROCEDURE, schema=schema))
    for retina, state, to, way in (
        (5.0, "misaligned_intraocular_navigation", "distance_to_retina_mm > 5.8", 0.8),
        (6.0, "misaligned_retinal_approach", "0.7 < distance_to_retina_mm <= 5.5", -0.5),
    ):
        graph = graph_at(measured(retina=retina), schema=schema)
        found = {one.state: one for one in nearest.changes(nearest.mask(graph), graph.measures)}
        (move,) = found[state].moves
        assert (move.to, round(move.way, 6)) == (to, way)


def test_a_margin_moves_the_bounds_by_the_standard_deviation_of_the_moment():
    cautious = load_procedure("subretinal_injection_cautious")
    values = measured(retina=0.9, radial=2.0, target=2.2)
    sds = {"distance_to_retina_mm": 0.05, "radial_mm": 0.05}
    graph = graph_at(values, schema=cautious.schema.widened(sds))
    nearest = Nearest(cautious, sds)
    found = {one.state: one for one in nearest.changes(nearest.mask(graph), values)}
    (move,) = found["retinal_contact"].moves
    assert move.to == "0.6 < distance_to_retina_mm <= 0.8"  # where contact is not certain, either
    assert round(move.way, 6) == -0.1


some = st.floats(-1, 12).map(lambda value: round(value, 3))


@example(0.0, 0.0, 0.0, 1.7, 0.0)
@given(some, some.map(abs), some.map(abs), st.floats(0, 20).map(lambda value: round(value, 3)), some)
def test_a_change_leads_to_its_state_and_a_smaller_change_of_one_measure_does_not(
    retina, radial, beyond, theta, wall
):
    measures = measured(retina, radial, radial + beyond, theta, wall)
    graph = graph_at(measures)
    engine = RuleEngine(PROCEDURE)
    now = engine(graph).state
    found = changes(graph)
    assert now not in found
    assert set(found) | {now} == {state.name for state in PROCEDURE.states}
    for state, change in found.items():
        if state in ("unknown", "tip_not_visible"):
            continue
        smallest = [
            (1e-9,) if move.way > 0 else (-1e-9,) if move.way else (1e-9, -1e-9) for move in change.moves
        ]
        reached = set()
        for nudges in product(
            *smallest
        ):  # a measure exactly at the threshold has an offset of 0 to either side
            moved = dict(measures)
            for move, nudge in zip(change.moves, nudges, strict=True):
                moved[move.measure] += move.way * (1 + 1e-9) + nudge
            reached.add(engine(graph_at(moved, graph)).state)
        assert state in reached, (state, change.moves)
        if len(change.moves) == 1 and change.moves[0].way:
            (move,) = change.moves
            short = {**measures, move.measure: measures[move.measure] + 0.98 * move.way}
            assert engine(graph_at(short, graph)).state != state
