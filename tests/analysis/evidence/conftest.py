"""Results that support every claim about the default procedure."""

from pathlib import Path

import pytest
from evidence_files import record, write_faults, write_scores

from haptigraph.analysis.evaluation.origin import Origin, new_origin
from haptigraph.analysis.evidence import run_evidence
from haptigraph.analysis.evidence.gathering import Results
from haptigraph.assemble import load_procedure


@pytest.fixture(scope="session")
def origin() -> Origin:
    return new_origin(load_procedure("subretinal_injection"))


@pytest.fixture(scope="session")
def recording(sparse_uri: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(sparse_uri, tmp_path_factory.mktemp("evidence") / "run.mcap")


@pytest.fixture
def in_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take recordings for those of runs in real time."""
    monkeypatch.setattr(run_evidence, "is_realtime", lambda config: True)


@pytest.fixture
def results(tmp_path: Path, origin: Origin, recording: Path, in_real_time: None) -> Results:
    """Complete results, as of a run in real time."""
    return Results(
        write_faults(tmp_path / "faults.jsonl", origin),
        [write_scores(tmp_path / "accuracy.json", origin)],
        [recording],
    )
