from itertools import pairwise
from pathlib import Path

import pytest

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import replay
from haptigraph.config import load_config
from haptigraph.errors import BadInput


@pytest.fixture(scope="module")
def recording(quick_uri, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "r.mcap"
    settings = (f"source.uri={quick_uri}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, settings)).run()
    return path


def test_a_replay_is_identical_step_by_step(recording):
    report = replay(recording)
    assert report.steps == report.identical == 117
    assert report.first is report.states.first_step is report.haptics.first_step is None
    assert report.difference == 0
    assert report.notes == ()
    assert report.recorded.completion_s == report.replayed.completion_s > 1
    assert (report.is_whole, report.dropped_images) == (True, 0)


def test_another_procedure_leads_to_other_steps(recording, procedure, tmp_path):
    strict = tmp_path / "strict.toml"
    strict.write_text(procedure.text.replace("at_most = 5.5", "at_most = 9.0"))
    steps = []
    report = replay(recording, str(strict), watch=lambda *both: steps.append(both))
    assert 0 < report.identical < report.steps
    assert report.first.message == "graph"
    assert "approaching" in report.first.replayed
    assert "approaching" not in report.first.recorded
    assert report.difference is None
    other = report.states
    assert (other.recorded, other.replayed) == (
        "misaligned_intraocular_navigation",
        "misaligned_retinal_approach",
    )
    assert 0 < other.first_step < report.steps
    near = "misaligned_retinal_approach"
    assert report.replayed.state_s[near] > report.recorded.state_s[near]
    lasts_s = [
        (later.stamp_ns - before.stamp_ns) / 1e9
        for (before, after), (later, _) in pairwise(steps)
        if before.conclusion.state != after.conclusion.state
    ]
    assert (len(lasts_s), sum(lasts_s)) == (other.steps, pytest.approx(other.lasts_s))


def test_a_change_of_a_pattern_alone_differs_in_the_command(recording, procedure, tmp_path):
    loud = tmp_path / "loud.toml"
    loud.write_text(procedure.text.replace("amplitude = 0.3", "amplitude = 0.9"))
    report = replay(recording, str(loud))
    assert report.first.message == "command"
    assert report.states_differ == report.states.lasts_s == 0
    assert report.haptics_differ > 0 and report.haptics.recorded == report.haptics.replayed == "low"
    assert report.haptics.lasts_s == pytest.approx(report.recorded.vibrating_s["low"])


def test_an_unknown_procedure_is_refused(recording):
    with pytest.raises(BadInput, match="unknown procedure"):
        replay(recording, "nothing")


def test_a_run_of_another_version_says_so(recording, monkeypatch):
    monkeypatch.setattr("haptigraph.analysis.metrics.replay.__version__", "9.9.9")
    (note,) = replay(recording).notes
    assert note.endswith("replayed by 9.9.9: steps also differ where perception has changed since")
