"""Queries and the form: one SELECT over the archive's tables, and nothing else."""

import re
import shutil
import subprocess
import sys

import pytest
from paths import ROOT

from haptigraph.analysis.archive.dictionary import RUNS, STEPS
from haptigraph.analysis.archive.finding import Condition, Filter, find, measures_of
from haptigraph.analysis.archive.index import update_archive
from haptigraph.analysis.archive.query import query_archive
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader


@pytest.fixture(scope="module")
def archive(recordings, tmp_path_factory):
    folder = shutil.copytree(recordings, tmp_path_factory.mktemp("archive") / "recordings")
    update_archive(folder)
    return folder


@pytest.mark.parametrize(
    ("sql", "reason"),
    [
        ("drop view runs", "one SELECT statement"),
        ("create table t as select 1", "one SELECT statement"),
        ("select 1; select 2", "one SELECT statement"),
        ("set enable_external_access = true", "one SELECT statement"),
        ("copy runs to 'stolen.csv'", "one SELECT statement"),
        ("attach 'other.db'", "one SELECT statement"),
        ("select * from read_text('/etc/passwd')", "file system operations are disabled"),
        ("select * from '/etc/passwd'", "does not exist"),
        ("select * from read_csv('https://example.org/a.csv')", "disabled"),
        ("select * from archive", "does not exist"),
        ("selec", "syntax error"),
        ("", "one SELECT statement"),
    ],
)
def test_a_query_reaches_nothing_but_the_archive(archive, sql, reason, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match=reason):
        query_archive(archive, sql)
    assert list(tmp_path.iterdir()) == []


def test_columns_say_unit_and_meaning_of_every_column(archive):
    listed = query_archive(archive, "select table_name, name, unit from columns").rows
    for table in ("runs", "steps"):
        names = query_archive(archive, f"select * from {table} limit 0").columns
        assert sorted(names) == sorted(name for where, name, _ in listed if where == table)
    assert ("steps", "theta_deg", "deg") in listed and ("steps", "theta_sd_deg", "deg") in listed
    sql = "select meaning from columns where name in ('distance_to_retina_sd_mm', 'needle_tip_sd_mm')"
    assert all(meaning.startswith("standard deviation of") for (meaning,) in query_archive(archive, sql).rows)
    assert not any("_sd_" in name for name in measures_of(archive))
    sql = "select meaning from columns where name = 'theta_deg'"
    assert query_archive(archive, sql).rows[0][0].startswith("angle between the shaft and the line")
    assert all(column.meaning for column in RUNS)


def test_the_documentation_lists_the_columns():
    text = (ROOT / "docs/how_to/archive.md").read_text(encoding="utf-8")
    lines = {
        name: next(line for line in text.splitlines() if line.startswith(f"| `{name}`"))
        for name in ("runs", "steps")
    }
    for name, columns in (("runs", RUNS), ("steps", STEPS)):
        assert re.findall(r"`(\w+)`", lines[name])[1:] == [column.name for column in columns]


def test_rows_are_limited_and_the_answer_says_so(archive):
    assert query_archive(archive, "select step from steps", max_rows=3)._replace(rows=[]).is_complete is False
    assert query_archive(archive, "select 1", max_rows=3).is_complete


def test_a_filter_finds_what_a_loop_over_all_steps_finds(archive):
    limits = (Condition("theta_deg", "above", 5.0), Condition("distance_to_retina_mm", "below", 3.0))
    expected = {}
    for path in sorted(archive.rglob("run-*.mcap")):
        for number, (_, step) in enumerate(RunReader(path).records(images=())):
            measures = step.graph.measures
            if measures.get("theta_deg", 0) > 5 and measures.get("distance_to_retina_mm", 99) < 3:
                expected.setdefault(path.relative_to(archive).as_posix(), number)
    answer = find(archive, Filter(conditions=limits))
    assert expected
    assert {row[0]: row[-1] for row in answer.rows} == expected


@pytest.mark.parametrize(
    ("given", "count"),
    [
        (Filter(), 5),
        (Filter(since="2026-07-02"), 3),
        (Filter(until="2026-07-01"), 2),
        (Filter(participant="P01", outcome="hit"), 1),
        (Filter(has_alarm=True), 4),
        (Filter(state="retinal_contact", participant="P02"), 1),
        (Filter(procedure="'; drop table runs; --"), 0),
        (Filter(state='" or true or "'), 0),
    ],
)
def test_fields_restrict_and_are_only_values(archive, given, count):
    assert len(find(archive, given).rows) == count


def test_a_measure_must_be_one_of_the_archive(archive):
    name = 'theta_deg" > 0 or "theta_deg'
    with pytest.raises(BadInput, match="unknown measure"):
        find(archive, Filter(conditions=(Condition(name, "above", 1.0),)))


def test_a_date_must_be_one(archive):
    with pytest.raises(BadInput, match="query: Conversion Error"):
        find(archive, Filter(since="yesterday"))


def test_without_an_archive_or_the_extra_a_sentence_says_what_to_do(tmp_path):
    with pytest.raises(BadInput, match="has no archive; create one with `haptigraph archive"):
        query_archive(tmp_path, "select 1")
    code = "import sys; sys.modules['duckdb'] = None\nimport haptigraph.analysis.archive.query"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "pip install 'haptigraph[archive]'" in done.stderr
