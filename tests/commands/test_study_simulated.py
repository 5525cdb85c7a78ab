"""A study is simulated, reported and swept by one command each."""

import csv
import shutil
import sys
from pathlib import Path

import pytest
from helpers import call, refuse

from haptigraph.analysis.study.figures import drawn
from haptigraph.analysis.study.figures.style import rendered
from haptigraph.study.exchange.exporting import TABLES


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two simulated participants of the paper's protocol with short trials."""
    return simulated(tmp_path_factory.mktemp("cli") / "mine", workers=1)


def simulated(folder, workers):
    assert call("study", "new", folder).exit_code == 0
    file = folder / "study.toml"
    text = file.read_text().replace("timeout_s = 300", "timeout_s = 4")
    file.write_text(text.replace("failed_trials = 2", "failed_trials = 0"))
    result = call("study", "simulate", folder, "--participants", "2", "--workers", workers)
    assert result.exit_code == 0
    assert "2 SIMULATED participants, 2 of them now: 6 trials" in result.output
    assert f"haptigraph study report {folder}" in result.output
    return folder


def reported(study, output):
    result = call("study", "report", study, "-o", output)
    assert result.exit_code == 0
    assert "SIMULATED: no people took part" in result.output
    return contents(output)


def contents(folder):
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def report(study, tmp_path_factory) -> Path:
    """The report of that study."""
    output = tmp_path_factory.mktemp("cli") / "report"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawn, "rendered", lambda figure: rendered(figure, ("svg",)))  # others take seconds
        reported(study, output)
    return output


def test_every_file_of_a_simulated_report_is_marked_as_simulated(study, report):
    files = contents(report)
    page = files["report.html"].decode()
    assert "<h1>Does touch help to align a needle?</h1>" in page
    assert "their answers are random" in page
    for name in ("results.tex", "results.md", "methods.txt"):
        assert "simulated" in files[name].decode().lower()
    for name in files:
        if name.endswith(".svg"):
            assert b"SIMULATED" in files[name], name
    assert "tables/study.json" in files
    checked = call("study", "check", study)
    assert checked.exit_code == 0  # recordings are unchanged
    assert "by SIMULATED participants" in checked.output
    assert "simulated participants" in call("study", "status", study).output


def test_a_report_says_that_the_protocol_was_edited_after_the_first_participant(
    study, report, tmp_path, monkeypatch
):
    monkeypatch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])
    said = "The protocol was edited after the first participant: study.toml was changed."
    assert said not in (report / "report.html").read_text()
    edited = shutil.copytree(study, tmp_path / "edited")
    file = edited / "study.toml"
    file.write_text(file.read_text().replace('expect = "smaller"', 'expect = "different"'))
    for folder, output in ((edited, "edited_report"), (tmp_path / "edited_report" / "tables", "again")):
        assert said in call("study", "report", folder, "-o", tmp_path / output).stdout
        assert f'<p class="mark">{said}' in (tmp_path / output / "report.html").read_text()
        assert said in (tmp_path / output / "methods.txt").read_text()
    imported = call(
        "study", "import", tmp_path / "edited_report" / "tables", "--store", tmp_path / "other.db"
    )
    assert imported.exit_code == 0


@pytest.mark.slow
def test_two_simulations_give_the_same_report(study, tmp_path):
    other = simulated(tmp_path / "other", workers=2)
    assert reported(study, tmp_path / "one") == reported(other, tmp_path / "two")


def test_an_export_as_parquet_has_the_same_tables(study, tmp_path):
    pandas = pytest.importorskip("pandas")
    assert call("study", "export", study, "-o", tmp_path / "out", "--parquet").exit_code == 0
    for name in TABLES:
        table = pandas.read_parquet(tmp_path / "out" / f"{name}.parquet")
        with (tmp_path / "out" / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(table.columns) == list(rows[0]) if rows else table.empty
        for column in table:
            for value, text in zip(table[column], (row[column] for row in rows), strict=True):
                assert (text == "") if pandas.isna(value) else (value == type(value)(text)), (name, column)


def test_a_report_of_a_study_without_participants_creates_no_files(tmp_path):
    assert call("study", "new", tmp_path / "mine").exit_code == 0
    output = refuse("study", "report", tmp_path / "mine", "-o", tmp_path / "report")
    assert "the first enrolment creates it" in output
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_sweep_writes_its_tables(study, tmp_path, monkeypatch):
    def spread(work, tasks, **_):
        return ((task, work(task)) for task in tasks)

    monkeypatch.setattr(
        "haptigraph.analysis.study_sweep.study_sweep.spread", spread
    )  # processes: tests/analysis
    before = {path: path.stat().st_mtime_ns for path in Path(study).iterdir()}
    arguments = (
        "study",
        "sweep",
        study,
        "-o",
        tmp_path / "out",
        "--participants",
        "3",
        "--vary",
        "tremor_mm=0,x2",
    )
    result = call(*arguments)
    assert result.exit_code == 0
    assert "12 trials of 6 participants" in result.output
    assert "; 6 participants were simulated now" in result.output
    with (tmp_path / "out" / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["variation"] for row in rows] == ["tremor_mm=0"] * 6 + ["tremor_mm=x2"] * 6
    assert {row["simulated"] for row in rows} == {"1"}
    power = [float(row["tremor_power_mm2"]) for row in rows]
    assert sum(power[:6]) < sum(power[6:])
    assert "SIMULATED" in (tmp_path / "out" / "summary.md").read_text()
    assert "; 0 participants were simulated now" in call(*arguments).output
    assert {path: path.stat().st_mtime_ns for path in Path(study).iterdir()} == before
    assert "unknown trait" in refuse(*arguments[:-1], "tremor=0")


def test_a_sweep_on_a_cluster_without_dask_names_the_extra(study, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "haptigraph.spreading.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = (
        "study",
        "sweep",
        study,
        "-o",
        tmp_path / "out",
        "--participants",
        1,
        "--cluster",
        "tcp://127.0.0.1:1",
    )
    assert "pip install 'haptigraph[cluster]'" in refuse(*arguments)


def test_a_cluster_is_encrypted_with_certificates_or_not_at_all(study, tmp_path):
    arguments = ("study", "sweep", study, "-o", tmp_path / "out")
    for options in (
        ("--tls", tmp_path),
        ("--cluster", "tls://lab:1"),
        ("--cluster", "tcp://lab:1", "--tls", tmp_path),
    ):
        assert "--tls FOLDER goes with --cluster tls://HOST:PORT" in refuse(*arguments, *options)
    assert "lacks ca.pem" in refuse(*arguments, "--cluster", "tls://127.0.0.1:1", "--tls", tmp_path)
