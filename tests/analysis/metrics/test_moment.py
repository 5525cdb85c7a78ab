"""Explanations of moments of recorded runs."""

from pathlib import Path

import pytest
from helpers import mostly_slow
from paths import GOLDEN

from haptigraph import assemble, run_device
from haptigraph.analysis.metrics.moment import explain_graph, explain_moment, explanation_text
from haptigraph.analysis.metrics.replay import replay
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.graph import SceneGraph
from haptigraph.messages import Fault
from haptigraph.recording.reader import RunReader

RUNS = sorted(path.stem for path in GOLDEN.glob("*.mcap"))


@pytest.mark.parametrize("moments", [3, pytest.param(20, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name", mostly_slow(RUNS, "ioct_approach", "membrane_peeling", "wrong_place_then_hit")
)
def test_every_moment_is_explained_by_its_recorded_conclusion(name, moments):
    path = GOLDEN / f"{name}.mcap"
    steps = [step for _, step in RunReader(path).places()]
    start_ns = steps[0].stamp_ns
    for step in steps[:: len(steps) // moments]:
        explanation = explain_moment(path, (step.stamp_ns - start_ns) / 1e9)
        assert (explanation.state, explanation.feel, explanation.because) == (
            step.conclusion.state,
            step.conclusion.feel,
            step.conclusion.because,
        )
        assert all(reason.holds for reason in explanation.fired_by)
        assert all(not reason.holds for reasons in explanation.not_fired.values() for reason in reasons)
        assert all(reasons for reasons in explanation.not_fired.values())
        assert explanation.runner_up is not None and explanation.runner_up.state != explanation.state


def test_the_text_has_triplets_thresholds_and_changes():
    text = explanation_text(explain_moment(GOLDEN / "wrong_place_then_hit.mcap", 8.0))
    assert "<needle_line, misaligned, retina_target>  (theta_deg 6.3" in text
    assert "bounds theta_deg > 1.7)" in text
    assert "runner-up  retinal_contact (rule 2, feels 'pulse')" in text
    assert "advance 1.10 mm along the shaft: the tip moves 1.14 mm" in text
    short = explanation_text(explain_moment(GOLDEN / "wrong_place_then_hit.mcap", 7.996), has_all=False)
    assert short.startswith(text[: text.index("  or  ")]) and short.endswith("--all shows what leads to them")
    assert "counter-clockwise, then advance" in text and "on the way: aligned_retinal_approach" in text
    assert "not considered" not in text


def test_where_no_needle_pivots_measures_change_and_the_text_says_so():
    explanation = explain_moment(GOLDEN / "membrane_peeling.mcap", 8.0)
    text = explanation_text(explanation)
    assert "mm less" in text and not any(change.motions for change in explanation.others)
    assert "motion     not considered: it needs the tip and the shaft of a needle" in text


def test_a_graph_that_fits_no_rule_is_explained(procedure):
    nodes = SceneGraph(0).nodes
    explanation = explain_graph(procedure, SceneGraph(0, nodes), faults=("source: stale image",))
    assert explanation.state == "unknown"
    assert "fault      source: stale image" in explanation_text(explanation)


def test_a_moment_outside_the_run_is_refused():
    with pytest.raises(BadInput, match=r"has no step at 99 s; valid: 0 to \d"):
        explain_moment(GOLDEN / "wrong_place_then_hit.mcap", 99)


def recorded(uri: str, procedure: str, path: Path, *more: str) -> list:
    """Record a run under a procedure, and return its steps."""
    settings = (
        f"source.uri={uri}",
        "run.realtime=false",
        f"recording.path={path}",
        f"run.procedure={procedure}",
        *more,
    )
    assemble.build(load_config(None, settings)).run()
    return [step for _, step in RunReader(path).places()]


def test_a_held_state_is_explained_together_with_the_state_of_its_graph(sparse_uri, tmp_path):
    text = assemble.load_procedure("subretinal_injection").text
    held = text.replace(
        'name = "misaligned_intraocular_navigation"\n',
        'name = "misaligned_intraocular_navigation"\nhold_ms = 300\n',
    )
    (tmp_path / "held.toml").write_text(held)
    steps = recorded(sparse_uri, str(tmp_path / "held.toml"), tmp_path / "run.mcap")
    step = next(one for one in steps if one.conclusion.because.startswith("held"))
    explanation = explain_moment(tmp_path / "run.mcap", (step.stamp_ns - steps[0].stamp_ns) / 1e9)
    assert explanation.held is not None and explanation.held.state == "misaligned_intraocular_navigation"
    assert explanation.state != explanation.held.state and all(
        reason.holds for reason in explanation.fired_by
    )
    head, *rest = explanation_text(explanation).splitlines()
    assert "misaligned_intraocular_navigation, feels 'low': held;" in head
    assert any(line.startswith(f"  by graph   {explanation.state}, rule") for line in rest)


def test_a_state_that_waited_is_explained_by_its_own_rule(sparse_uri, tmp_path):
    text = assemble.load_procedure("subretinal_injection").text
    name = 'name = "misaligned_retinal_approach"\n'
    (tmp_path / "late.toml").write_text(text.replace(name, f"{name}enter_after_ms = 200\n"))
    steps = recorded(sparse_uri, str(tmp_path / "late.toml"), tmp_path / "run.mcap")
    step = next(one for one in steps if one.conclusion.state == "misaligned_retinal_approach")
    explanation = explain_moment(tmp_path / "run.mcap", (step.stamp_ns - steps[0].stamp_ns) / 1e9)
    assert explanation.state == "misaligned_retinal_approach" and explanation.held is None
    assert all(reason.holds for reason in explanation.fired_by)


def test_values_that_follow_a_measure_are_those_of_the_moment(sparse_uri, tmp_path):
    steps = recorded(sparse_uri, "subretinal_injection_continuous", tmp_path / "run.mcap")
    step = next(one for one in steps if one.conclusion.feel == "lean")
    explanation = explain_moment(tmp_path / "run.mcap", (step.stamp_ns - steps[0].stamp_ns) / 1e9)
    assert explanation.held is None
    assert explanation.touch.startswith(f"'lean': amplitude {step.command.pattern.amplitude:g} at 80 Hz")


def test_a_device_that_had_failed_is_reported_until_it_responds_again(quick_uri, tmp_path, monkeypatch):
    monkeypatch.setitem(run_device.DEVICES, "flaky", "own_parts:FlakyDevice")
    steps = recorded(quick_uri, "subretinal_injection", tmp_path / "run.mcap", "haptics.device=flaky:3.0-4.0")
    start_ns = steps[0].stamp_ns
    (failed_s, lost), (back_s, back) = [
        ((step.stamp_ns - start_ns) / 1e9, fault) for step in steps for fault in step.observation.faults
    ]
    assert (lost, back) == (Fault("device", "unplugged"), Fault("device", "responds again", is_over=True))
    assert 3 <= failed_s < 4 <= back_s

    def faults_at(at_s: float) -> list[str]:
        lines = explanation_text(explain_moment(tmp_path / "run.mcap", at_s)).splitlines()
        return [line for line in lines if line.startswith("  fault ")]

    assert faults_at(failed_s - 0.04) == faults_at(back_s) == []
    assert faults_at(failed_s) == ["  fault      device: unplugged"]
    for at_s in (failed_s + 0.1, back_s - 0.01):
        assert faults_at(at_s) == [f"  fault      device: unplugged, since {failed_s:.2f} s"]


def test_a_margin_is_explained_with_the_recorded_standard_deviation(sparse_uri, tmp_path):
    steps = recorded(sparse_uri, "subretinal_injection_cautious", tmp_path / "run.mcap")
    both = [
        one for one in steps if {"touching", "approaching"} <= {edge.predicate for edge in one.graph.edges}
    ]
    bounds = {
        "bounds distance_to_retina_mm <= 0.7": next(
            one for one in both if one.conclusion.state == "retinal_contact"
        ),
        "bounds 0.7 < distance_to_retina_mm <= 5.5": next(
            one for one in both if one.graph.measures["distance_to_retina_mm"] > 0.7
        ),
    }
    for bound, step in bounds.items():
        assert step.graph.sds["radial_mm"] == step.observation.certainty.tip_sd_mm > 0
        at_s = (step.stamp_ns - steps[0].stamp_ns) / 1e9
        text = explanation_text(explain_moment(tmp_path / "run.mcap", at_s))
        sd = f"{step.graph.sds['distance_to_retina_mm']:.2g}"
        assert f"{bound}, margin 2 standard deviations of {sd})" in text
    report = replay(tmp_path / "run.mcap")
    assert report.identical == report.steps
