import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def test_a_measure_that_would_mean_two_things_is_called_otherwise():
    entities = Entity("edge", "tissue", "point"), Entity("retina", "anatomy", "polyline")
    plain = Relation("edge", "on", "retina", "distance_mm", at_most=1.0)
    called = Relation("edge", "above", "retina", "distance_mm", above=1.0, called="lift_mm")
    schema = Schema(entities, (plain, called))
    assert [schema.measure_name(each) for each in schema.relations] == ["distance_to_retina_mm", "lift_mm"]


@pytest.mark.parametrize("called", ["lift", "lift_deg", "lift off_mm"])
def test_a_measure_keeps_its_unit_whatever_it_is_called(called):
    with pytest.raises(ValueError, match="a name that ends in _mm"):
        Relation("edge", "above", "retina", "distance_mm", above=1.0, called=called)


def test_phases_stand_in_their_order():
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


def test_phi_names_the_category():
    assert GRAPH.phi("tip") == "needle_tip"
    with pytest.raises(KeyError):
        GRAPH.phi("forceps")


@given(edges, edges)
def test_a_diff_leads_from_one_graph_to_the_other(before, after):
    diff = SceneGraph(0, (TIP,), tuple(before)).diff(SceneGraph(1, (TIP,), tuple(after)))
    led = (set(before) - set(diff.edges_vanished)) | set(diff.edges_appeared)
    assert led == set(after)
    assert bool(diff) == (set(before) != set(after))


def test_a_diff_sees_nodes_come_and_go():
    diff = SceneGraph(0, (TIP, RETINA)).diff(SceneGraph(1, (RETINA, LINE)))
    assert diff.nodes_appeared == ("line",)
    assert diff.nodes_vanished == ("tip",)


@given(edges)
def test_json_brings_back_the_same_graph(some_edges):
    graph = SceneGraph(7, (TIP, LINE, RETINA), tuple(some_edges), {"a_mm": 0.1, "b_mm": 1 / 3})
    assert SceneGraph.from_json(graph.to_json()) == graph


def test_json_reads_like_the_paper():
    data = msgspec.json.decode(GRAPH.to_json())
    assert data["edges"][0] == {"subject": "tip", "predicate": "touching", "object": "retina"}
    assert str(TOUCHING) == "<tip, touching, retina>"


def test_json_of_something_else_is_refused():
    with pytest.raises(msgspec.ValidationError):
        SceneGraph.from_json(b'{"stamp_ns": 1, "edges": [3]}')


def test_networkx_gets_nodes_edges_and_measures():
    copy = GRAPH.to_networkx()
    assert copy.nodes["tip"] == {"category": "needle_tip", "group": "instrument"}
    assert list(copy.edges(keys=True)) == [("tip", "retina", "touching"), ("line", "retina", "aligned")]
    assert copy.graph["theta_deg"] == 1.5


@pytest.mark.parametrize(
    ("bounds", "true", "false"),
    [
        ({"at_most": 0.7}, (-3.0, 0.7), (0.71,)),
        ({"below": 0.0}, (-0.1,), (0.0, 1.0)),
        ({"at_least": 0.0}, (0.0, 1.0), (-0.1,)),
        ({"above": 0.7, "at_most": 5.5}, (0.71, 5.5), (0.7, 5.51)),
    ],
)
def test_bounds_are_open_and_closed_as_they_say(bounds, true, false):
    relation = Relation("a", "r", "b", "distance_mm", **bounds)
    assert all(relation.holds(value) for value in true)
    assert not any(relation.holds(value) for value in false)


def test_release_holds_on_beyond_the_upper_bound():
    relation = Relation("a", "r", "b", "distance_mm", above=0.2, at_most=0.7, release=0.8)
    assert not relation.holds(0.75)
    assert relation.holds(0.75, held=True)
    assert not relation.holds(0.81, held=True)
    assert not relation.holds(0.1, held=True)  # the other bound is not relaxed


def test_release_holds_on_beyond_the_lower_bound():
    relation = Relation("a", "r", "b", "theta_deg", above=2.0, release=1.7)
    assert not relation.holds(1.9)
    assert relation.holds(1.9, held=True)
    assert not relation.holds(1.6, held=True)


def test_measures_are_named_after_what_they_lead_to():
    retina = Entity("retina_surface", "anatomy", "polyline", label="retina")
    forceps = Entity("forceps", "instrument", "point")
    schema = Schema((retina, forceps), ())
    assert schema.measure_name(Relation("a", "r", "retina_surface", "distance_mm")) == "distance_to_retina_mm"
    assert schema.measure_name(Relation("a", "r", "forceps", "distance_mm")) == "distance_to_forceps_mm"
    assert schema.measure_name(Relation("a", "r", "forceps", "theta_deg")) == "theta_deg"
    with pytest.raises(KeyError):
        schema.entity("iris")
