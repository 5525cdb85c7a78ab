"""The index: what it says of each recording, and that it follows the folder."""

import os
import shutil

import pytest
from pyarrow import parquet

from haptigraph.analysis.archive.index import update_archive
from haptigraph.analysis.archive.query import query_archive, staleness
from haptigraph.analysis.archive.tables import Archive
from haptigraph.analysis.metrics.replay import recorded_procedure
from haptigraph.analysis.metrics.run import measure_run
from haptigraph.assemble import build
from haptigraph.checksum import sha256_of
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.reader import RunReader

pytestmark = pytest.mark.usefixtures("in_this_process")
NAMES = [f"P{number:02}/run-{40 * (number - 1):04}.mcap" for number in range(1, 5)]


def rows(folder, sql):
    return query_archive(folder, sql).rows


def test_a_row_has_header_hash_outcome_and_times(folder):
    updated = update_archive(folder)
    assert (updated.indexed, updated.unchanged, updated.removed) == (5, 0, 0)
    ((name, problem),) = updated.damaged
    assert name == "damaged.mcap" and "damaged" in problem
    steps = [step for _, step in RunReader(folder / NAMES[0]).records(images=())]
    measures = measure_run(steps)
    columns = (
        "sha256, steps, outcome, completion_s, contacts, participant, procedure, problem, is_interrupted"
    )
    (row,) = rows(folder, f"select {columns} from runs where recording = '{NAMES[0]}'")
    assert row == (
        sha256_of(folder / NAMES[0]), 117, "hit", measures.completion_s, measures.contacts, "P01",
        "subretinal_injection", "", False,
    )  # fmt: skip
    ((states,),) = rows(folder, f"select state_s from runs where recording = '{NAMES[0]}'")
    assert {state: time_s for state, time_s in states.items() if time_s} == measures.all_state_s
    ((hits,),) = rows(folder, "select count(*) from runs where outcome = 'no hit'")
    assert hits == 3  # the shorter ones end before it


def test_a_state_that_never_occurred_has_a_time_of_0(folder):
    update_archive(folder)
    sql = "select state_s, run_state_s from runs where problem = ''"
    procedure = recorded_procedure(RunReader(folder / NAMES[0]))
    names = {state.name for state in procedure.states}
    found = rows(folder, sql)
    assert all(set(state_s) == set(run_state_s) == names for state_s, run_state_s in found)
    assert any(0 in state_s.values() for state_s, _ in found)
    assert len(found) == 4


def index_another(folder, name, setting):
    """Record a run on a recording's images with one more setting, and index it, too."""
    settings = f"source.uri={folder / NAMES[0]}", "run.realtime=false", f'recording.path="{folder / name}"'
    build(load_config(None, (*settings, setting))).run()
    update_archive(folder)


def test_a_row_has_the_settings_that_were_not_the_default(folder):
    index_another(folder, "weak.mcap", "haptics.max_amplitude=0.5")
    sql = "select recording from runs where settings like '%haptics.max_amplitude=0.5%'"
    assert rows(folder, sql) == [("weak.mcap",)]
    assert rows(folder, "select count(*) from runs where settings like '%recording.path%'") == [(0,)]


def test_steps_are_those_of_the_recordings(folder):
    update_archive(folder)
    steps = [step for _, step in RunReader(folder / NAMES[1]).records(images=())]
    sql = f"select step, state, theta_deg from steps where recording = '{NAMES[1]}' order by step"
    assert rows(folder, sql) == [
        (number, step.conclusion.state, step.graph.measures.get("theta_deg"))
        for number, step in enumerate(steps)
    ]


def test_a_step_has_the_standard_deviations_that_were_recorded(folder):
    index_another(folder, "cautious.mcap", "run.procedure=subretinal_injection_cautious")
    for name, has_margins in ((NAMES[1], False), ("cautious.mcap", True)):
        steps = [step for _, step in RunReader(folder / name).records(images=())]
        columns = "needle_tip_sd_mm, needle_line_sd_deg, distance_to_retina_sd_mm"
        found = rows(folder, f"select {columns} from steps where recording = '{name}' order by step")
        for row, step in zip(found, steps, strict=True):
            of = step.observation.certainty
            perceived = (None, None) if of is None else (of.tip_sd_mm, of.theta_sd_deg)
            assert row == (*perceived, step.graph.sds.get("distance_to_retina_mm"))
        assert any(row[0] for row in found)
        assert any(row[2] for row in found) == has_margins


def test_an_index_of_another_version_is_made_again(folder):
    update_archive(folder)
    assert not update_archive(folder).is_made_again
    file = folder / "archive" / "runs.parquet"
    table = parquet.read_table(file).drop_columns(["outcome"])
    parquet.write_table(table.replace_schema_metadata({"haptigraph.archive": "2"}), file)
    with pytest.raises(
        BadInput, match="of another version of haptigraph; bring it up to date with `haptigraph"
    ):
        rows(folder, "from runs")
    updated = update_archive(folder)
    assert (updated.is_made_again, updated.indexed, updated.unchanged) == (True, 5, 0)
    assert rows(folder, "select count(*) from runs where outcome = 'hit'") == [(1,)]
    assert len(list(file.parent.glob("steps-*.parquet"))) == 1


def test_an_update_reads_only_what_has_changed_and_erases_what_is_gone(folder):
    update_archive(folder)
    assert update_archive(folder).indexed == 0
    os.utime(folder / NAMES[0])
    (folder / NAMES[1]).unlink()
    assert staleness(folder).startswith("1 recordings are new or changed and 1 recordings are gone since")
    updated = update_archive(folder)
    assert (updated.indexed, updated.unchanged, updated.removed) == (1, 3, 1)
    assert staleness(folder) == ""
    counts = dict(rows(folder, "select recording, count(*) from steps group by recording"))
    assert counts == {NAMES[0]: 117, NAMES[2]: 77, NAMES[3]: 57}
    for part in Archive(folder).place.glob("steps-*"):
        assert NAMES[1].encode() not in part.read_bytes()


def test_a_part_that_a_killed_update_left_does_not_count(folder):
    update_archive(folder)
    place = Archive(folder).place
    (part,) = place.glob("steps-*.parquet")
    (place / "steps-000099.parquet").write_bytes(part.read_bytes())
    assert rows(folder, "select count(*) from steps") == [(117 + 97 + 77 + 57,)]
    update_archive(folder)
    assert [file.name for file in place.glob("steps-*.parquet")] == [part.name]


def test_recordings_outside_the_folder_are_left_out(folder, tmp_path):
    (folder / "outside.mcap").symlink_to(tmp_path / "elsewhere.mcap")
    (tmp_path / "elsewhere.mcap").write_bytes((folder / NAMES[0]).read_bytes())
    assert update_archive(folder).indexed == 5


def test_only_one_program_updates(folder):
    update_archive(folder)
    with not_being_written(folder / "archive" / "lock"), pytest.raises(BadInput, match="is being updated"):
        update_archive(folder)


def test_an_index_that_cannot_be_read_is_named(folder):
    update_archive(folder)
    (folder / "archive" / "runs.parquet").write_bytes(b"no table")
    with pytest.raises(BadInput, match=r"runs\.parquet: cannot be read .* delete it"):
        update_archive(folder)


def test_more_workers_make_the_same_archive(folder, tmp_path, monkeypatch):
    update_archive(folder)
    other = tmp_path / "other"
    shutil.copytree(folder, other, ignore=shutil.ignore_patterns("archive"))
    monkeypatch.undo()
    update_archive(other, workers=2)
    for sql in ("from runs order by recording", "from steps order by recording, step"):
        assert rows(other, sql) == rows(folder, sql)
