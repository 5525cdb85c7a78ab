import math
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import MissingExtra
from haptigraph.graph import Entity, Node, Relation, SceneGraph, Schema, Triplet

TIP, LINE, RETINA = (
    Node("tip", "needle_tip", "instrument"),
    Node("line", "needle_line", "instrument"),
    Node("retina", "retina_surface", "anatomy"),
)
TOUCHING, ALIGNED = Triplet("tip", "touching", "retina"), Triplet("line", "aligned", "retina")
GRAPH = SceneGraph(5, (TIP, LINE, RETINA), (TOUCHING, ALIGNED), {"theta_deg": 1.5})

names = st.sampled_from(["tip", "line", "retina"])
edges = st.lists(
    st.builds(Triplet, names, st.sampled_from(["touching", "aligned"]), names), unique=True, max_size=8
)


def test_an_alias_names_a_measure_whose_default_name_would_be_ambiguous():
    entities = Entity("edge", "tissue", "point"), Entity("retina", "anatomy", "polyline")
    plain = Relation("edge", "on", "retina", "distance_mm", at_most=1.0)
    renamed = Relation("edge", "above", "retina", "distance_mm", above=1.0, alias="lift_mm")
    schema = Schema(entities, (plain, renamed))
    assert [schema.measure_name(each) for each in schema.relations] == ["distance_to_retina_mm", "lift_mm"]


def test_the_unit_of_a_measure_is_the_last_part_of_its_name():
    assert Relation("edge", "above", "retina", "wall_gap_mm", above=1.0, alias="lift_mm").alias == "lift_mm"


@pytest.mark.parametrize("alias", ["lift", "lift_deg", "lift off_mm"])
def test_an_alias_must_end_in_the_unit_of_the_measure(alias):
    with pytest.raises(ValueError, match="alias must be a name that ends in _mm"):
        Relation("edge", "above", "retina", "distance_mm", above=1.0, alias=alias)


def test_phases_are_in_the_order_of_the_schema():
    phases = tuple(Entity(name, "phase", "phase") for name in ("insertion", "approach"))
    assert Schema((Entity("tip", "instrument", "point"), *phases), ()).phases == ("insertion", "approach")


def test_edges_are_found_by_any_part():
    assert GRAPH.find() == (TOUCHING, ALIGNED)
    assert GRAPH.find(subject="tip") == (TOUCHING,)
    assert GRAPH.find(predicate="aligned", object="retina") == (ALIGNED,)
    assert GRAPH.find(object="retina") == (TOUCHING, ALIGNED)
    assert GRAPH.find(subject="retina") == ()
    assert TOUCHING in GRAPH
    assert Triplet("tip", "aligned", "retina") not in GRAPH


def test_phi_returns_the_category():
    assert GRAPH.phi("tip") == "needle_tip"
    with pytest.raises(KeyError):
        GRAPH.phi("forceps")


@given(edges, edges)
def test_a_diff_leads_from_one_graph_to_the_other(before, after):
    diff = SceneGraph(0, (TIP,), tuple(before)).diff(SceneGraph(1, (TIP,), tuple(after)))
    patched = (set(before) - set(diff.edges_vanished)) | set(diff.edges_appeared)
    assert patched == set(after)
    assert bool(diff) == (set(before) != set(after))


def test_a_diff_lists_nodes_that_appear_and_vanish():
    diff = SceneGraph(0, (TIP, RETINA)).diff(SceneGraph(1, (RETINA, LINE)))
    assert diff.nodes_appeared == ("line",)
    assert diff.nodes_vanished == ("tip",)


@given(edges)
def test_json_round_trip_preserves_the_graph(some_edges):
    graph = SceneGraph(7, (TIP, LINE, RETINA), tuple(some_edges), {"a_mm": 0.1, "b_mm": 1 / 3})
    assert SceneGraph.from_json(graph.to_json()) == graph


def test_json_uses_the_terms_of_the_paper():
    data = msgspec.json.decode(GRAPH.to_json())
    assert data["edges"][0] == {"subject": "tip", "predicate": "touching", "object": "retina"}
    assert str(TOUCHING) == "<tip, touching, retina>"


def test_json_that_is_not_a_graph_is_refused():
    with pytest.raises(msgspec.ValidationError):
        SceneGraph.from_json(b'{"stamp_ns": 1, "edges": [3]}')


def test_the_networkx_copy_has_nodes_edges_and_measures():
    copy = GRAPH.to_networkx()
    assert copy.nodes["tip"] == {"category": "needle_tip", "group": "instrument"}
    assert list(copy.edges(keys=True)) == [("tip", "retina", "touching"), ("line", "retina", "aligned")]
    assert copy.graph == {"stamp_ns": 5, "theta_deg": 1.5}


@pytest.mark.parametrize(
    ("bounds", "true", "false"),
    [
        ({"at_most": 0.7}, (-3.0, 0.7), (0.71,)),
        ({"below": 0.0}, (-0.1,), (0.0, 1.0)),
        ({"at_least": 0.0}, (0.0, 1.0), (-0.1,)),
        ({"above": 0.7, "at_most": 5.5}, (0.71, 5.5), (0.7, 5.51)),
    ],
)
def test_at_most_and_at_least_include_the_threshold_and_below_and_above_do_not(bounds, true, false):
    relation = Relation("a", "r", "b", "distance_mm", **bounds)
    assert all(relation.holds(value) for value in true)
    assert not any(relation.holds(value) for value in false)


@pytest.mark.parametrize("upper", ["at_most", "below"])
def test_release_extends_the_upper_bound_up_to_and_including_itself(upper):
    relation = Relation("a", "r", "b", "distance_mm", above=0.2, release=0.8, **{upper: 0.7})
    assert not relation.holds(0.75)
    assert not relation.holds(0.8)
    assert relation.holds(0.75, held=True)
    assert relation.holds(0.8, held=True)
    assert not relation.holds(math.nextafter(0.8, 1.0), held=True)
    assert not relation.holds(0.2, held=True)  # the other bound is not relaxed


@pytest.mark.parametrize("lower", ["at_least", "above"])
def test_release_extends_the_lower_bound_down_to_and_including_itself(lower):
    relation = Relation("a", "r", "b", "theta_deg", at_most=5.0, release=1.7, **{lower: 2.0})
    assert not relation.holds(1.9)
    assert not relation.holds(1.7)
    assert relation.holds(1.9, held=True)
    assert relation.holds(1.7, held=True)
    assert not relation.holds(math.nextafter(1.7, 1.0), held=True)
    assert not relation.holds(math.nextafter(5.0, 6.0), held=True)  # the other bound is not relaxed


@pytest.mark.parametrize(
    ("bound", "includes"), [("at_most", True), ("below", False), ("at_least", True), ("above", False)]
)
def test_a_release_at_the_bound_itself_includes_it_while_the_relation_holds(bound, includes):
    relation = Relation("a", "r", "b", "distance_mm", release=0.7, **{bound: 0.7})
    assert relation.holds(0.7) is includes
    assert relation.holds(0.7, held=True)


def test_distances_are_named_after_their_object():
    retina = Entity("retina_surface", "anatomy", "polyline", label="retina")
    forceps = Entity("forceps", "instrument", "point")
    schema = Schema((retina, forceps), ())
    assert schema.measure_name(Relation("a", "r", "retina_surface", "distance_mm")) == "distance_to_retina_mm"
    assert schema.measure_name(Relation("a", "r", "forceps", "distance_mm")) == "distance_to_forceps_mm"
    assert schema.measure_name(Relation("a", "r", "forceps", "theta_deg")) == "theta_deg"
    with pytest.raises(KeyError):
        schema.entity("iris")


def test_equal_graphs_give_equal_bytes_in_whatever_order_their_measures_came():
    one, other = {"theta_deg": 1.5, "wall_mm": 2.0}, {"wall_mm": 2.0, "theta_deg": 1.5}
    assert replace(GRAPH, measures=one).to_json() == replace(GRAPH, measures=other).to_json()


def test_without_networkx_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "networkx", None)
    with pytest.raises(MissingExtra, match=r"^SceneGraph\.to_networkx needs .*haptigraph\[scenegraph\]"):
        GRAPH.to_networkx()


def test_unknown_names_are_in_the_error():
    with pytest.raises(KeyError, match="lens"):
        GRAPH.phi("lens")
    with pytest.raises(KeyError, match="lens"):
        Schema((), ()).entity("lens")


@given(st.integers(-8, 40), st.integers(0, 8), st.booleans())
def test_a_margin_widens_every_bound_and_the_release(value, sd, held):
    """On a grid of 1/8: the relation holds if some value within two standard deviations satisfies its bounds."""
    for relation in (
        Relation("a", "r", "b", "distance_mm", at_most=2.0, margin_sd=2.0),
        Relation("a", "r", "b", "distance_mm", below=2.0, release=2.5, margin_sd=2.0),
        Relation("a", "r", "b", "distance_mm", above=1.0, at_most=3.0, release=3.5, margin_sd=2.0),
        Relation("a", "r", "b", "distance_mm", at_least=1.0, release=0.5, margin_sd=2.0),
    ):
        holds = relation.holds(value / 8, held=held, margin=relation.margin(sd / 8))
        widened = relation.widened(sd / 8)
        near = [value / 8 + step / 16 for step in range(-4 * sd, 4 * sd + 1)]
        assert holds == any(relation.holds(one, held=held) for one in near)
        assert widened.margin_sd == 0
        assert holds == widened.holds(value / 8, held=held)


@pytest.mark.parametrize("value", [-1e300, 0.0, 1e300])
def test_nothing_is_excluded_if_the_standard_deviation_is_unknown(value):
    relation = Relation("a", "r", "b", "distance_mm", above=1.0, below=2.0, release=2.5, margin_sd=2.0)
    assert relation.holds(value, margin=relation.margin(None))
    assert relation.widened(None).holds(value)
    plain = replace(relation, margin_sd=0.0)
    assert plain.margin(None) == 0.0 and plain.widened(None) == plain
