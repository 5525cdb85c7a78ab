"""The command `evidence`: files, exit codes, what it prints."""

import re

import pytest
from evidence_files import record, write_faults, write_scores
from helpers import call, refuse

from haptigraph.analysis.evaluation.origin import new_origin
from haptigraph.analysis.evidence import run_evidence
from haptigraph.assemble import load_procedure


def test_evidence_is_written_and_what_is_missing_is_printed(tmp_path):
    result = call("evidence", "subretinal_injection", "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert "MISSING: However a run ends, the actuator is silent afterwards" in result.output
    assert re.search(r"^\d+ of \d+ claims hold; the others: \d+ missing; open ", result.output, re.MULTILINE)
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["argument.svg", "evidence.csv", "evidence.html", "evidence.md"]
    html = (tmp_path / "out" / "evidence.html").read_text()
    assert "not a medical device" in html and "no compliance with ISO 14971" in html
    assert "http://" not in html.replace("http://www.w3.org/2000/svg", "") and "https://" not in html


def test_the_exit_code_is_0_if_every_claim_holds(tmp_path, sparse_uri, monkeypatch):
    monkeypatch.setattr(run_evidence, "is_realtime", lambda config: True)
    origin = new_origin(load_procedure("subretinal_injection"))
    options = {
        "--faults": write_faults(tmp_path / "faults.jsonl", origin),
        "--evaluation": write_scores(tmp_path / "accuracy.json", origin),
        "--run": record(sparse_uri, tmp_path / "run.mcap"),
        "-o": tmp_path / "out",
    }
    result = call("evidence", *(part for option in options.items() for part in option))
    assert result.exit_code == 0, result.output
    assert re.match(r"all \d+ claims hold; open ", result.output)


@pytest.mark.parametrize("option", ["--faults", "--evaluation", "--run"])
def test_a_file_that_is_no_result_is_refused(tmp_path, option):
    file = tmp_path / "file"
    file.write_text("nothing")
    assert str(file) in refuse("evidence", option, file, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "evidence.csv").write_text("mine")
    assert "evidence.csv: exists already" in refuse("evidence", "-o", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["evidence.csv"]
