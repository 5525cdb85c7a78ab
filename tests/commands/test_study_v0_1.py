"""Studies, exports and sweeps of version 0.1.0 are opened, resumed, reported, imported and erased."""

import csv
import json
import re
import shutil
import sqlite3
from contextlib import closing

import pytest
from helpers import call
from paths import ROOT

from haptigraph.analysis.study.figures import drawn
from haptigraph.analysis.study.figures.style import rendered

DECIMAL = re.compile(r"-?\d+\.\d+(e-?\d+)?")
V0_1 = ROOT / "tests" / "data" / "v0_1"
TABLES = ("participants", "sessions", "stages", "answers", "trials", "events")
REDEFINED = {"path_mm", "sparc", "log_jerk", "tremor_power_mm2"}
OLD_KEYS = "ease.toml, line 12: key 'low_says' is now called 'low_label'"

pytestmark = pytest.mark.filterwarnings("default::UserWarning")


@pytest.fixture
def updated(tmp_path):
    """A simulated study that 0.1.0 froze, with two complete participants, as it was."""
    return shutil.copytree(V0_1 / "study", tmp_path / "study")


@pytest.fixture
def study(updated):
    """The same study with its procedure, which has changed since, restored from an export."""
    frozen = json.loads((V0_1 / "export/study.json").read_text())["parts"]
    (updated / "subretinal_injection.toml").write_text(frozen["procedure subretinal_injection"])
    return updated


def succeed(*arguments):
    result = call("study", *arguments)
    assert result.exit_code == 0, result.stderr
    return result


def exported(folder):
    """Return the rows of all tables, without the columns that version 0.1 did not have."""
    tables = {}
    for name in TABLES:
        with (V0_1 / "export" / f"{name}.csv").open(newline="") as file:
            columns = next(csv.reader(file))
        with (folder / f"{name}.csv").open(newline="") as file:
            tables[name] = [[row[column] for column in columns] for row in csv.DictReader(file)]
    return tables


def trials_of(folder):
    with (folder / "trials.csv").open(newline="") as file:
        return [{**row, "software": ""} for row in csv.DictReader(file)]


def typed(row):
    """Return a row with its measures as numbers, because other processors round differently."""
    return {name: float(text) if DECIMAL.fullmatch(text) else text for name, text in row.items()}


def test_a_frozen_study_is_checked_and_shown(study):
    checked = succeed("check", study)
    assert "frozen since 2000-01-01 09:00 UTC, by SIMULATED participants" in checked.output
    assert "6 of 6 recordings are unchanged" in checked.output
    assert "sha256 0b81bc497e8aa37a1c5087a0aff9dca02bbad2cf81cf7c3f21707763962dc5a0" in checked.output
    assert checked.stderr.count(OLD_KEYS) == 1
    assert "2 of 2 participants" in succeed("status", study).output


def test_a_frozen_study_does_not_go_on_under_a_shipped_procedure_that_has_changed(updated):
    result = call("study", "check", updated)
    assert result.exit_code == 2
    assert (
        "procedure subretinal_injection was changed since; save its text in study.json of an export as "
        "subretinal_injection.toml beside study.toml" in result.stderr
    )


def test_files_may_be_updated_to_the_new_keys_and_not_changed(study):
    file = study / "ease.toml"
    text = file.read_text()
    file.write_text(text.replace("_says", "_label"))
    procedure = study / "subretinal_injection.toml"
    procedure.write_text(procedure.read_text().replace("seen_with", "visible_with"))
    assert succeed("check", study).stderr == ""
    file.write_text(text.replace("Strongly agree", "Agree"))
    assert "questionnaire ease.toml was changed since" in call("study", "check", study).stderr


def test_an_export_is_the_same_and_is_imported(study, tmp_path):
    succeed("export", study, "-o", tmp_path / "out")
    assert exported(tmp_path / "out") == exported(V0_1 / "export")
    before, after = (
        json.loads((where / "study.json").read_text()) for where in (V0_1 / "export", tmp_path / "out")
    )
    assert after == {**before, "edited_parts": []}
    succeed("import", V0_1 / "export", "--store", tmp_path / "other.db")
    succeed("export", study, "-o", tmp_path / "again", "--store", tmp_path / "other.db")
    assert exported(tmp_path / "again") == exported(V0_1 / "export")


def test_a_report_is_written_without_warnings_about_recorded_procedures(study, tmp_path, monkeypatch):
    monkeypatch.setattr(drawn, "rendered", lambda figure: rendered(figure, ("svg",)))  # others take seconds
    result = succeed("report", study, "-o", tmp_path / "report")
    assert [line for line in result.stderr.splitlines() if "is now called" not in line] == []
    assert "SIMULATED" in (tmp_path / "report/report.html").read_text()
    monkeypatch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])  # drawn above
    assert succeed("report", V0_1 / "export", "-o", tmp_path / "other").stderr == ""


def test_a_simulation_is_resumed(study, tmp_path):
    assert "2 SIMULATED participants, 0 of them now" in succeed("simulate", study).output
    with closing(sqlite3.connect(study / "study.db")) as store:
        store.execute("DELETE FROM stages WHERE participant = 'S02' AND stage = 'thanks'")
        store.commit()
    assert "was started as 'simulated participant: seed 1, perceiver known" in refused_simulation(study)
    resumed = succeed("simulate", study, "--perceiver", "known")
    assert "2 SIMULATED participants, 1 of them now: 3 trials" in resumed.output
    assert "--perceiver: 'known' is now called 'ground-truth'" in resumed.stderr
    succeed("export", study, "-o", tmp_path / "out")
    before, after = trials_of(V0_1 / "export"), trials_of(tmp_path / "out")
    for row in (*before, *after):
        del row["recording_sha256"], row["procedure_sha256"]
    assert len(after) == len(before) == 6
    kept = before[0].keys() - REDEFINED
    for row, row_before in zip(after, before, strict=True):
        again, once = ({name: each[name] for name in kept} for each in (row, row_before))
        assert typed(again) == pytest.approx(typed(once), rel=1e-6)
    # the others keep the measures that were stored
    assert {row["participant"] for row in after if row["images_per_s"]} == {"S02"}


def refused_simulation(study):
    result = call("study", "simulate", study, "--perceiver", "tracker")
    assert result.exit_code == 2
    return result.stderr


def test_a_participant_is_erased(study):
    assert succeed("erase", study, "S02", "--yes").stdout.endswith("S02 is erased\n")
    checked = succeed("check", study).output
    assert "3 of 3 recordings are unchanged\n1 withdrew, 1 of them with all data erased" in checked


@pytest.mark.parametrize("trait", ["glance_deviation_deg", "glance_sd_deg"])
def test_a_sweep_is_resumed_under_the_old_and_the_new_name_of_its_trait(study, tmp_path, trait, monkeypatch):
    def spread(work, tasks, **_):
        return ((task, work(task)) for task in tasks)

    monkeypatch.setattr("haptigraph.analysis.study_sweep.study_sweep.spread", spread)
    out = shutil.copytree(V0_1 / "sweep", tmp_path / "sweep")
    before = measure_again(study, out, tmp_path / "new")
    arguments = ("sweep", study, "-o", out, "--participants", "3", "--vary", f"{trait}=x2")
    result = succeed(*arguments)
    assert "6 trials of 3 participants" in result.output
    assert "; 1 participants were simulated now" in result.output
    renamed = "--vary: trait 'glance_deviation_deg' is now called 'glance_sd_deg'"
    assert result.stderr.count(renamed) == (trait == "glance_deviation_deg")
    after = trials_of(out)
    assert {row["variation"] for row in after} == {"glance_sd_deg=x2"}
    assert after[: len(before)] == before
    assert "; 0 participants were simulated now" in succeed(*arguments).output
    with closing(sqlite3.connect(out / "results.db")) as results:
        about = dict(results.execute("SELECT name, value FROM about"))
        rows = json.loads(results.execute("SELECT trials FROM results").fetchone()[0])
    assert (about["perceiver"], rows[0]["variation"]) == ("ground-truth", "glance_sd_deg=x2")


def measure_again(study, out, new):
    """Replace the stored measures of a sweep by today's; return its trials."""
    succeed("sweep", study, "-o", new, "--participants", "2", "--vary", "glance_sd_deg=x2")
    with closing(sqlite3.connect(new / "results.db")) as results:
        rows = results.execute("SELECT trials, participant FROM results").fetchall()
    with closing(sqlite3.connect(out / "results.db")) as results:
        old = [(trials.replace("glance_sd_deg", "glance_deviation_deg"), number) for trials, number in rows]
        results.executemany("UPDATE results SET trials = ? WHERE participant = ?", old)
        results.commit()
    return trials_of(new)


def test_a_sweep_whose_measures_have_been_redefined_is_not_resumed(study, tmp_path):
    out = shutil.copytree(V0_1 / "sweep", tmp_path / "sweep")
    arguments = ("--participants", "3", "--vary", "glance_sd_deg=x2")
    assert "has other settings" in call("study", "sweep", study, "-o", out, *arguments).stderr


def test_a_sweep_with_other_settings_is_not_resumed(study, tmp_path):
    out = shutil.copytree(V0_1 / "sweep", tmp_path / "sweep")
    file = study / "study.toml"
    file.write_text(file.read_text().replace("timeout_s = 3", "timeout_s = 2.5"))
    assert "has other settings: protocol_sha256 was 0b81bc" in call("study", "sweep", study, "-o", out).stderr
