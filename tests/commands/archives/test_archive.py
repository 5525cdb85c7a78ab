"""The commands archive, query and batch."""

import csv
import io
import shutil

import pytest
from helpers import call, refuse
from pyarrow import parquet


@pytest.fixture(scope="module")
def folder(quick_uri, tmp_path_factory):
    """A folder with a recording and a file that is none."""
    folder = tmp_path_factory.mktemp("recordings")
    assert call("run", quick_uri, "--fast", "--record", folder / "run.mcap").exit_code == 0
    (folder / "notes.mcap").write_text("Remember the milk.")
    return folder


def test_an_archive_is_indexed_and_queried(folder):
    text = call("archive", folder, "--workers", 1).output
    assert "2 recordings indexed, 0 unchanged, 0 removed" in text
    assert "cannot be read: notes.mcap: not a recording" in text
    assert "0 recordings indexed, 2 unchanged" in call("archive", folder).output
    table = call(
        "query", "--archive", folder, "select recording, outcome, steps from runs order by steps"
    ).stdout
    lines = table.splitlines()
    assert lines[0].split() == ["recording", "outcome", "steps"]
    assert lines[2].split() == ["run.mcap", "hit", "117"]
    assert lines[-1] == "(2 rows)"
    text = call(
        "query", "--archive", folder, "--csv", "select recording, steps from runs where steps > 0"
    ).stdout
    assert list(csv.reader(io.StringIO(text))) == [["recording", "steps"], ["run.mcap", "117"]]


def test_csv_has_a_column_for_each_key_of_a_map(folder):
    call("archive", folder, "--workers", 1)
    sql = "select recording, state_s, problem from runs order by recording"
    text = call("query", "--archive", folder, "--csv", sql).stdout
    notes, run = csv.DictReader(io.StringIO(text))
    assert notes["state_s.retinal_contact"] == "" and notes["problem"]
    assert float(run["state_s.aligned_retinal_approach"]) > 0
    none = call("query", "--archive", folder, "--csv", f"{sql} limit 0").stdout
    assert none.splitlines() == ["recording,state_s,problem"]


def test_rows_too_wide_for_a_table_are_lists(folder):
    call("archive", folder, "--workers", 1)
    lines = call("query", "--archive", folder, "from runs order by recording").stdout.splitlines()
    assert lines[0].split() == ["recording", "notes.mcap"]
    (states,) = (line for line in lines if line.startswith("state_s  ") and "outside_eye" in line)
    assert "{" not in states
    assert max(map(len, states.split())) < 40  # no number of 16 digits
    assert lines[-1] == "(2 rows)"


def test_a_query_says_that_the_index_is_out_of_date(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("archive"))
    call("archive", copy, "--workers", 1)
    shutil.copy(copy / "run.mcap", copy / "new.mcap")
    result = call("query", "--archive", copy, "select count(*) from runs")
    assert "1 recordings are new or changed since the index was made" in result.stderr


def test_an_index_of_another_version_is_made_again_and_said_so(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("archive"))
    call("archive", copy, "--workers", 1)
    table = parquet.read_table(copy / "archive" / "runs.parquet").replace_schema_metadata(None)
    parquet.write_table(table, copy / "archive" / "runs.parquet")
    assert "of another version" in refuse("query", "--archive", copy, "select 1")
    assert call("archive", copy, "--workers", 1).output.splitlines()[:2] == [
        "the index was of another version of haptigraph, and is made again",
        "2 recordings indexed, 0 unchanged, 0 removed",
    ]


def test_refusals_are_one_sentence(folder, tmp_path):
    assert "has no archive" in refuse("query", "--archive", tmp_path, "select 1")
    assert "one SELECT statement" in refuse("query", "--archive", folder, "drop view runs")
    assert "is no folder" in refuse("archive", tmp_path / "none")
    assert "--procedure goes with replay" in refuse(
        "batch", "measure", folder, "-o", tmp_path / "a", "--procedure", "x"
    )
    assert "unknown procedure" in refuse("batch", "replay", folder, "-o", tmp_path / "b", "--procedure", "x")


def test_a_batch_reports_and_is_resumed(folder, tmp_path):
    arguments = ("batch", "replay", folder, "-o", tmp_path / "out", "--workers", 1)
    text = call(*arguments, "--page", "http://lab:1").output
    assert "2 recordings now" in text and "1 recording, 1 passed over" in text
    assert "states differ for 0.00 s in 0 of 117 steps, haptic output for 0.00 s in 0" in text
    assert "117 of 117 steps identical\n" in text
    assert "haptigraph live --recordings" in text
    assert "0 recordings now" in call(*arguments).output
    assert "Remember" not in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "recordings.csv").is_file()
