"""A fixed part of the campaign of `make faults`."""

import subprocess
import sys
from pathlib import Path

import campaign
import pytest
from campaign import TRIALS, planned, table
from fault_rig import environment

from haptigraph.analysis.evaluation.origin import software_sha256
from haptigraph.analysis.evidence.campaign import read_campaign

pytest.importorskip("serial")
pytest.importorskip("sdl2", exc_type=ImportError)


@pytest.mark.slow
def test_some_faults_of_each_kind_break_no_promise(tmp_path):
    results = tmp_path / "results.jsonl"
    command = [
        sys.executable,
        campaign.__file__,
        "--scale",
        "0.012",
        "--minutes",
        "1",
        "--skip",
        "raw images",  # a busy machine loses some; `make interop` has them
        "--results",
        str(results),
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=115)
    assert done.returncode == 0, done.stderr
    trials = read_campaign(results, TRIALS)
    assert len(trials) >= 10
    assert {session.origin.software_sha256 for session, _ in trials} == {software_sha256()}
    assert "| broken promises |" in done.stdout


def test_a_whole_campaign_has_1500_trials_and_60_of_each_kind():
    kinds = [kind for kind, _ in planned(1.0, "")]
    assert len(kinds) >= 1500
    assert min(kinds.count(kind) for kind in campaign.TRIALS) >= 60


def test_a_broken_promise_is_a_result(tmp_path, monkeypatch):
    def breaks(rng, folder: Path):
        assert folder.is_dir()
        raise campaign.trials.BrokenPromise("it vibrates")

    monkeypatch.setitem(campaign.TRIALS, "hung process", (1, breaks))
    result = campaign.run_trial("hung process", 3, 1, tmp_path)
    assert result.failure == "BrokenPromise: it vibrates"
    assert "| hung process | 1 | 1 |" in table([result])
