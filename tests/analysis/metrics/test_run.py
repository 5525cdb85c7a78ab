import pytest
from helpers import MS, make_step
from msgspec.structs import replace

from haptigraph.analysis.metrics.run import RunMeasures, measure_run
from haptigraph.analysis.metrics.summary import summary
from haptigraph.graph import SceneGraph, Schema, Triplet
from haptigraph.inference.span import RunSpan
from haptigraph.messages import Fault
from haptigraph.run_report import RunReport

INSIDE = Triplet("needle_tip", "inside", "eye_globe")


def step(ms, state, theta_deg=None, *, inside=True, faults=()):
    measures = {} if theta_deg is None else {"theta_deg": theta_deg}
    graph = SceneGraph(ms * MS, (), (INSIDE,) if inside else (), measures)
    return replace(make_step(stamp_ns=ms * MS, state=state, faults=faults), graph=graph)


@pytest.fixture
def run():
    """Outside, inside and misaligned, contact twice, aligned, hit, held."""
    return [
        step(0, "outside_eye", inside=False),
        step(1000, "misaligned_intraocular_navigation", 6.0),
        step(3000, "retinal_contact", 6.0),
        step(3500, "misaligned_retinal_approach", 4.0),
        step(4000, "retinal_contact", 4.0),
        step(4100, "unknown"),
        step(4200, "aligned_retinal_approach", 1.0),
        step(6200, "target_hit", 0.0),
        step(9000, "target_hit", 0.0),
        step(9500, "unknown", inside=False, faults=(Fault("source", "ended"),)),
    ]


def test_a_run_lasts_from_first_inside_to_first_hit(run):
    measures = measure_run(run)
    assert measures.completion_s == pytest.approx(5.2)
    assert measures.contacts == 2
    assert measures.state_s == pytest.approx(
        {
            "misaligned_intraocular_navigation": 2.0,
            "retinal_contact": 0.6,
            "misaligned_retinal_approach": 0.5,
            "unknown": 0.1,
            "aligned_retinal_approach": 2.0,
        }
    )
    assert sum(measures.state_s.values()) == pytest.approx(measures.completion_s)
    assert measures.all_state_s["target_hit"] == pytest.approx(3.3)
    assert measures.all_state_s["outside_eye"] == pytest.approx(1.0)
    assert measures.order == [
        "misaligned_intraocular_navigation",
        "retinal_contact",
        "misaligned_retinal_approach",
        "retinal_contact",
        "unknown",
        "aligned_retinal_approach",
        "target_hit",
    ]


def test_mean_theta_is_weighted_by_time_where_the_needle_was_detected(run):
    detected_s = 2.0 + 0.5 + 0.5 + 0.1 + 2.0
    expected = (2.0 * 6 + 0.5 * 6 + 0.5 * 4 + 0.1 * 4 + 2.0 * 1) / detected_s
    assert measure_run(run).mean_theta_deg == pytest.approx(expected)


def test_what_happens_after_the_hit_does_not_count(run):
    later = [*run[:-1], step(9600, "retinal_contact", 9.0), step(9900, "unknown")]
    assert measure_run(later).contacts == 2
    assert measure_run(later).completion_s == pytest.approx(5.2)


def test_a_run_without_hit_has_no_completion(run):
    measures = measure_run(run[:5])
    assert measures.completion_s is None
    assert measures.is_running
    assert "no target hit" in summary(measures)


def test_without_entry_there_is_no_run():
    measures = measure_run([step(0, "outside_eye", inside=False), step(100, "unknown", inside=False)])
    assert (measures.completion_s, measures.mean_theta_deg, measures.contacts) == (None, None, 0)
    assert "none: <needle_tip, inside, eye_globe> never occurred" in summary(measures)
    assert RunMeasures().completion_s is None


def test_the_summary_covers_surgeon_and_loop(run):
    report = RunReport(steps=10, wall_s=2.0, overruns=3, skipped=1, dropped=2)
    report.faults["source: gone"] += 4
    report.stages["perceive"].add(7_000_000)
    text = summary(measure_run(run), report)
    for message in (
        "target hit after 5.20 s",
        "contacts        2 unintended, 6 state changes",
        "10 steps in 2.0 s, 5.0 steps/s, source ended",
        "3 late, 1 skipped, 2 not recorded",
        "perceive          7.0",
        "4 x source: gone",
    ):
        assert message in text


def test_a_procedure_without_the_starting_edge_is_named_as_the_reason(procedure):
    relations = [relation for relation in procedure.schema.relations if relation.predicate != "inside"]
    measures = RunMeasures.under(
        replace(procedure, schema=Schema(procedure.schema.entities, tuple(relations)))
    )
    assert "none: the procedure has no <needle_tip, inside, eye_globe>" in summary(measures)
    assert "never occurred" in summary(RunMeasures.under(procedure))


def test_the_time_in_a_state_is_exact():
    measures = measure_run([step(0, "outside_eye", inside=False), step(1000, "unknown")])
    assert measures.all_state_s == {"outside_eye": 1.0}


def test_the_span_of_a_run_is_that_of_the_procedure(procedure):
    span = RunSpan(begins=("needle_tip", "inside", "eye_globe"), ends_in="retinal_contact")
    measures = RunMeasures.under(replace(procedure, span=span, temporal=()))
    for each in (step(0, "misaligned_retinal_approach"), step(500, "retinal_contact")):
        measures.add(each)
    assert measures.completion_s == 0.5


def test_the_list_of_states_is_bounded(monkeypatch):
    monkeypatch.setattr("haptigraph.analysis.metrics.run.MAX_ORDER", 3)
    states = ["misaligned_retinal_approach", "retinal_contact"] * 3
    measures = measure_run([step(40 * number, state) for number, state in enumerate(states)])
    assert (len(measures.order), measures.contacts) == (3, 3)


def test_steps_without_a_visible_tip_are_counted_and_the_longest_time_reported():
    states = [(0, "outside_eye"), (100, "tip_not_visible"), (200, "tip_not_visible"), (500, "target_hit")]
    measures = measure_run([step(ms, state) for ms, state in [*states, (600, "tip_not_visible")]])
    assert (measures.tipless_steps, measures.steps) == (3, 5)
    assert measures.longest_tipless_s == pytest.approx(0.4)
    assert "tip             not visible in 3 of 5 steps (60.0 %), for up to 0.40 s" in summary(measures)


def test_a_run_whose_tip_was_always_visible_or_without_needle_says_nothing_of_it(run):
    assert "not visible" not in summary(measure_run(run))
