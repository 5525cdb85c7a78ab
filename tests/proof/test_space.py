"""The graphs that proofs consider possible are those that relations and the scene builder produce."""

import math

import paths
import pytest
from helpers import mostly_slow, needle
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.geometry import Point, Segment
from haptigraph.graph import Entity, Relation, Schema
from haptigraph.messages import Certainty, Observation
from haptigraph.proof.intervals import Interval, atoms
from haptigraph.proof.scales import scales_of
from haptigraph.proof.space import Space
from haptigraph.recording.reader import RunReader
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.scene.relations import MEASURES

GOLDEN = sorted(paths.GOLDEN.glob("*.mcap"))
ENTITIES = (Entity("a", "instrument", "point"), Entity("b", "anatomy", "point"))
NO_MARGIN = st.just(0.0)
GRID = st.integers(0, 8).map(lambda half: half / 2)


@st.composite
def relations(draw, margins=NO_MARGIN) -> tuple[Relation, ...]:
    """Up to four relations of one distance, with any bounds and releases that the loader accepts."""
    made = []
    for number in range(draw(st.integers(1, 4))):
        low, high = sorted(draw(st.lists(GRID, min_size=2, max_size=2, unique=True)))
        kind = draw(st.sampled_from(["upper", "lower", "both"]))
        bounds = {}
        if kind != "lower":
            bounds[draw(st.sampled_from(["at_most", "below"]))] = high
        if kind != "upper":
            bounds[draw(st.sampled_from(["at_least", "above"]))] = low
        further = st.floats(0.25, 2).map(lambda by: round(by * 4) / 4)
        if draw(st.booleans()):
            goes_up = (kind != "lower" and draw(st.booleans())) or kind == "upper"
            bounds["release"] = high + draw(further) if goes_up else low - draw(further)
        made.append(Relation("a", f"r{number}", "b", "distance_mm", **bounds, margin_sd=draw(margins)))
    return tuple(made)


@given(relations())
def test_cells_have_exactly_the_sets_of_relations_that_can_hold_after_any_sequence(schema_relations):
    """On a grid of 1/8 mm, every value after every other: the masks of the cells, no more and no less."""
    (scale,) = scales_of(Schema(ENTITIES, schema_relations), MEASURES)
    values = [eighth / 8 for eighth in range(0, 100)]

    def after(value: float, held: int) -> int:
        return sum(
            1 << at for at, one in enumerate(schema_relations) if one.holds(value, held=bool(held >> at & 1))
        )

    reached, fresh = {0}, [0]
    while fresh:
        held = fresh.pop()
        for mask in {after(value, held) for value in values} - reached:
            reached.add(mask)
            fresh.append(mask)
    for value in values:
        assert set(scale.cell_at(value).masks) == {after(value, held) for held in reached}
    assert scale.cells[0].interval.has_low  # a distance of 0 is possible


@settings(max_examples=12)
@given(relations(margins=st.sampled_from([0.0, 2.0])))
def test_with_margins_cells_have_exactly_the_sets_that_some_standard_deviation_gives(schema_relations):
    """On a grid of 1/16 mm, with standard deviations on a grid of 1/64 mm."""
    (scale,) = scales_of(Schema(ENTITIES, schema_relations), MEASURES)

    def holding(value: float, sd: float) -> tuple[int, int]:
        enter = hold = 0
        for at, one in enumerate(schema_relations):
            enter |= one.holds(value, margin=one.margin(sd)) << at
            hold |= one.holds(value, held=True, margin=one.margin(sd)) << at
        return enter, hold

    holdings = {
        eighth / 16: {holding(eighth / 16, sd / 64) for sd in range(0, 64 * 5)} for eighth in range(0, 110)
    }
    reached, fresh = {0}, [0]
    while fresh:
        held = fresh.pop()
        for mask in {enter | hold & held for each in holdings.values() for enter, hold in each} - reached:
            reached.add(mask)
            fresh.append(mask)
    for value, each in holdings.items():
        assert set(scale.cell_at(value).masks) == {
            enter | hold & held for held in reached for enter, hold in each
        }


sds = st.floats(0, 10) | st.sampled_from([0.0, 1e-30, 1e300])


@given(
    relations(margins=st.floats(0.001, 10) | st.sampled_from([0.0, 1.0, 2.0])),
    st.lists(st.tuples(st.floats(0, 10) | GRID, sds | st.none()), min_size=1, max_size=20),
)
def test_what_holds_after_any_values_and_standard_deviations_is_in_their_cells(schema_relations, walk):
    (scale,) = scales_of(Schema(ENTITIES, schema_relations), MEASURES)
    held = 0
    for value, sd in walk:
        held = sum(
            one.holds(value, held=bool(held >> at & 1), margin=one.margin(sd)) << at
            for at, one in enumerate(schema_relations)
        )
        near = (scale.cell_at(value + offset) for offset in (0, 1e-9, -1e-9))  # for rounding at crossings
        assert any(held in cell.masks for cell in near)


@given(st.lists(GRID, max_size=5), GRID)
def test_every_value_is_in_exactly_one_atom(bounds, value):
    assert sum(value in atom for atom in atoms(bounds)) == 1
    assert all(atom.sample() in atom for atom in atoms(bounds))


@pytest.mark.parametrize(
    ("interval", "condition", "value", "offset"),
    [
        (Interval(0.7, 5.5, False, True), "0.7 < d <= 5.5", 6.5, -1.0),
        (Interval(high=1.7, has_high=True), "d <= 1.7", 1.0, 0.0),
        (Interval(low=1.5), "d > 1.5", 1.0, 0.5),
        (Interval(2.0, 2.0, True, True), "d = 2", 3.0, -1.0),
        (Interval(), "any d", 3.0, 0.0),
    ],
)
def test_an_interval_gives_its_condition_and_the_offset_to_it(interval, condition, value, offset):
    assert interval.describe("d") == condition
    assert interval.offset_from(value) == offset


points = st.tuples(st.floats(-15, 15), st.floats(-15, 15))


@given(st.lists(st.none() | st.tuples(points, points, st.booleans()), min_size=1, max_size=6), st.booleans())
def test_the_graph_of_any_needle_is_possible(registration, needles, releases):
    schema = load_procedure("subretinal_injection").schema
    if releases:
        ends = {
            ("touching", "retina_surface"): 0.9,
            ("aligned", "retina_target"): 2.5,
            ("inside", "eye_globe"): -0.5,
        }
        released = [replace(one, release=ends.get((one.predicate, one.object))) for one in schema.relations]
        schema = Schema(schema.entities, tuple(released))
    space = Space(schema)
    possible = {world.mask for world in space.worlds()}
    build = SchemaSceneBuilder(schema)
    for seen in needles:
        found = dict(registration.anatomy)
        if seen is not None and math.dist(*seen[:2]) > 0.1:
            found |= needle(*seen[:2])
            if not seen[2]:
                del found["needle_tip"]
        graph = build(Observation(0, found))
        assert space.mask(graph) in possible
    assert space.mask(build(Observation(0, {}))) in possible


certainties = st.builds(
    Certainty,
    st.just(1.0),
    st.none() | st.floats(0, 3) | st.sampled_from([0.0, math.nan, math.inf]),
    st.floats(0, 5) | st.just(math.nan),
)
CAUTIOUS = load_procedure("subretinal_injection_cautious")


@given(
    st.lists(st.tuples(points, points, st.none() | certainties), min_size=1, max_size=6),
    st.lists(
        st.sampled_from([0.0, 0.5, 2.0, 10.0]),
        min_size=len(CAUTIOUS.schema.relations),
        max_size=len(CAUTIOUS.schema.relations),
    ),
)
def test_the_graph_of_any_needle_with_any_certainty_is_possible(registration, needles, margins):
    """Also with other margins, on relations that share a measure and on those that do not."""
    others = zip(CAUTIOUS.schema.relations, margins, strict=True)
    changed = tuple(replace(one, margin_sd=margin) for one, margin in others)
    for schema in (CAUTIOUS.schema, Schema(CAUTIOUS.schema.entities, changed)):
        space, build = Space(schema), SchemaSceneBuilder(schema)
        possible = {world.mask for world in space.worlds()}
        for entry, tip, certainty in needles:
            if math.dist(entry, tip) > 0.1:
                found = {**registration.anatomy, **needle(entry, tip)}
                assert space.mask(build(Observation(0, found, certainty=certainty))) in possible


@pytest.mark.parametrize(
    "name",
    mostly_slow(procedure_names(), "subretinal_injection", "subretinal_injection_4d", "membrane_peeling"),
)
def test_the_example_of_every_possible_graph_produces_it(name):
    """Its measures and standard deviations, where no relation holds only because it held before."""
    space = Space(load_procedure(name).schema)
    for world in space.worlds():
        graph, raw = space.graph(world), 0
        widened = space.schema.widened(graph.sds)
        for at, relation in enumerate(widened.relations):
            measure = graph.measures.get(widened.measure_name(relation))
            held = bool(space.edge_bits[relation.names] & world.mask)
            raw |= (measure is not None and relation.holds(measure, held=held)) << at
        assert space.close(raw) == world.mask & space.edges


@pytest.mark.parametrize("name", procedure_names())
def test_an_instrument_may_be_seen_without_its_tip_and_never_the_other_way_round(name):
    space = Space(load_procedure(name).schema)
    assert space.only_with
    for part, whole in space.only_with:
        seen = {(bool(world.mask & part), bool(world.mask & whole)) for world in space.worlds()}
        assert seen == {(False, False), (False, True), (True, True)}
    for present in space.entity_sets():
        for cluster in space.clusters:
            assert space.toggled(present | space.fixed, cluster) in set(space.entity_sets())


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_every_recorded_graph_is_possible(path):
    reader = RunReader(path)
    space = Space(parse_procedure(reader.info.procedure, path.name).schema)
    possible = {world.mask for world in space.worlds()}
    assert {space.mask(step.graph) for _, step in reader.places()} <= possible


@given(points, points, points, st.tuples(points, points))
def test_the_geometric_limits_of_measures_hold(tip, target, trocar, shaft):
    if math.dist(target, trocar) < 1e-3 or math.dist(*shaft) < 1e-3:
        return
    found = {"trocar": Point(trocar)}
    values = {
        "distance_mm": MEASURES["distance_mm"].function(Point(tip), Point(target), found),
        "radial_mm": MEASURES["radial_mm"].function(Point(tip), Point(target), found),
        "theta_deg": MEASURES["theta_deg"].function(Segment(*shaft), Point(target), found),
    }
    for name, value in values.items():
        limits = next(iter(MEASURES[name].shapes.values()))
        assert limits.lower <= value <= limits.upper
        if limits.never_above:
            assert value <= values[limits.never_above] + 1e-9


def test_no_measure_bounds_another_that_bounds_a_third():
    """`Space.is_consistent` checks pairs, which is sufficient as long as there are no chains."""
    bounding = {limits.never_above for one in MEASURES.values() for limits in one.shapes.values()} - {""}
    assert not any(limits.never_above for name in bounding for limits in MEASURES[name].shapes.values())


@pytest.mark.parametrize("missing", ["trocar"])
def test_an_undeclared_entity_that_a_measure_requires_may_be_absent(missing):
    schema = load_procedure("subretinal_injection").schema
    others = Schema(tuple(one for one in schema.entities if one.name != missing), schema.relations)
    space = Space(others)
    assert space.undeclared == (missing,)
    tip = space.entity_bits["needle_tip"]
    assert any(world.mask & tip and not world.mask & space.edges & 0b110011 for world in space.worlds())
