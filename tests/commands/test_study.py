import csv
import math
import subprocess
import sys
from contextlib import closing

import pytest
from helpers import call, refuse
from sqlalchemy import update

from haptigraph.config import load_config
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import TRIALS


@pytest.fixture
def folder(tmp_path):
    assert call("study", "new", tmp_path / "mine").exit_code == 0
    return tmp_path / "mine"


def begin(folder):
    study = Study(load_protocol(folder), Store(folder / "study.db"))
    session = open_session(study, study.enrol(), "one")
    for key in ("briefing", "consent"):
        session.done(key)
    return session


def test_help_lists_the_commands_of_a_study():
    text = call("study", "--help").output
    for command in ("new", "run", "check", "status", "export", "import", "report", "erase"):
        assert f"\n  {command} " in text


def test_the_papers_protocol_is_written_once_and_checks(folder):
    before = (folder / "study.toml").read_bytes()
    assert "exists already" in refuse("study", "new", folder)
    assert (folder / "study.toml").read_bytes() == before
    output = call("study", "check", folder).output
    for text in ("visual_haptic > visual_only", "questionnaire/sus/2", "not frozen", "no errors"):
        assert text in output
    assert "at most 20 % of the time without a visible tip" in output
    assert "no participant yet" in call("study", "status", folder).output
    assert sorted(path.name for path in folder.iterdir()) == ["study.toml"]


def test_the_preregistration_is_written_before_the_first_participant(folder):
    file = folder / "preregistration.md"
    output = call("study", "check", folder, "--preregistration", file).output
    assert "register it before the first participant comes" in output
    text = file.read_text()
    assert "Generated from the protocol before the first participant." in text
    assert load_protocol(folder).sha256 in text and "## Analysis" in text
    assert "never overwritten" in refuse("study", "check", folder, "--preregistration", file)
    begin(folder)
    later = folder / "later.md"
    assert "register it" not in call("study", "check", folder, "--preregistration", later).output
    assert "that the first participant froze in" in later.read_text()


def test_unblind_says_where_nothing_is_hidden(folder):
    assert "--unblind has no effect" in call("study", "check", folder, "--unblind").output


def test_check_warns_where_condition_and_target_cannot_be_separated(folder):
    assert "warning" not in call("study", "check", folder).output
    text = (folder / "study.toml").read_text().replace("participants = 16", "participants = 1")
    (folder / "study.toml").write_text(text)
    checked = call("study", "check", folder)
    assert "warning: condition and target cannot be separated: " in checked.output
    assert "only under visual_haptic" in checked.output and checked.exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--source", "phantom:none"), "unknown scenario 'none'"),
        (("--source", "camera:0"), "camera:0 needs a registration; give --registration FILE"),
        (("--device", "none"), "unknown device 'none'"),
        (("--station", " "), "--station '': a name has 1 to 80 characters"),
        (("--store", "mysql://lab"), "found 'mysql://lab'"),
    ],
)
def test_an_unusable_setup_is_reported_when_the_station_starts(folder, quick_uri, arguments, message):
    assert message in refuse("study", "run", folder, "--source", quick_uri, *arguments)
    assert sorted(path.name for path in folder.iterdir()) == ["study.toml"]


def test_an_invalid_protocol_is_refused_with_one_sentence(folder):
    file = folder / "study.toml"
    file.write_text(file.read_text().replace('design = "within"', 'design = "within-subject"'))
    message = refuse("study", "check", folder)
    assert "study.toml, line 9: unknown design 'within-subject'; did you mean 'within'?" in message


def test_without_the_extra_a_protocol_is_checked_and_a_store_names_it(folder):
    def without(*arguments):
        code = "import sys; sys.modules['sqlalchemy'] = None\nfrom haptigraph.cli import main\nmain(sys.argv[1:])"
        command = [sys.executable, "-c", code, "study", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True)

    assert "no errors" in without("check", folder).stdout
    (folder / "study.db").touch()
    for command in ("status", "run"):
        done = without(command, folder)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert "pip install 'haptigraph[study]'" in done.stderr


def test_status_and_check_report_participants_and_an_edit(folder):
    session = begin(folder)
    session.study.store.close()
    output = call("study", "status", folder).output
    assert "1 of 16 participants" in output
    assert "questionnaire/demographics" in output and "2 of 10" in output
    assert "frozen since" in call("study", "check", folder).output
    file = folder / "study.toml"
    file.write_text(file.read_text() + "\n# a remark\n")
    for command in ("check", "status"):
        assert "study.toml was changed since" in refuse("study", command, folder)


def test_a_recorded_trial_is_hashed_measured_exported_and_imported(folder, quick_uri, tmp_path):
    import haptigraph

    session = begin(folder)
    for item in session.study.protocol.questionnaire("demographics").items:
        session.answer(
            "questionnaire/demographics", item.key, "30" if item.kind == "number" else item.choices[0]
        )
    session.done("questionnaire/demographics")
    key = session.next().stage.key
    config = session.config(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    session.begin_trial(key)
    with closing(haptigraph.build(config)) as loop:
        for _ in loop.steps():
            pass
    assert loop.report.steps == 117
    session.end_trial("hit")
    session.study.store.close()
    assert "1 of 1 recordings are unchanged" in call("study", "check", folder).output

    assert call("study", "export", folder, "-o", tmp_path / "out").exit_code == 0
    with (tmp_path / "out" / "trials.csv").open(newline="") as file:
        (trial,) = csv.DictReader(file)
    assert float(trial["mean_theta_deg"]) > 1 and float(trial["vibrating_s"]) > 1
    info = RunReader(folder / trial["recording"]).info
    x, y = parse_registration(info.registration, "recorded").target.at_mm
    assert 12 * math.atan2(x, -y) == pytest.approx(-4.0, abs=0.05)  # the target "left"
    assert (info.participant, info.trial) == ("P01", "training/0/0/1/1")
    assert len(trial["recording_sha256"]) == 64
    output = call("study", "import", tmp_path / "out", "--store", tmp_path / "other.db").output
    assert "study sight_and_touch is in" in output
    assert "already contains study sight_and_touch" in refuse(
        "study", "import", tmp_path / "out", "--store", tmp_path / "other.db"
    )
    again = call("study", "export", folder, "-o", tmp_path / "again", "--store", tmp_path / "other.db")
    assert again.exit_code == 0
    assert (tmp_path / "again" / "trials.csv").read_bytes() == (tmp_path / "out" / "trials.csv").read_bytes()

    measured = (tmp_path / "out" / "trials.csv").read_bytes()
    with closing(Store(folder / "study.db")) as store, store.begin() as connection:
        connection.execute(update(TRIALS).values(measures='{"path_mm": 1.0}'))  # by an earlier version
    assert "1 of 1 recorded trials are measured" in call("study", "measure", folder).output
    assert call("study", "export", folder, "-o", tmp_path / "new").exit_code == 0
    assert (tmp_path / "new" / "trials.csv").read_bytes() == measured

    recording = folder / trial["recording"]
    recording.write_bytes(recording.read_bytes() + b"\0")
    result = call("study", "check", folder)
    assert result.exit_code == 1
    assert f"{trial['recording']} was changed; its SHA-256 differs" in result.stderr
    result = call("study", "measure", folder)
    assert result.exit_code == 1 and "0 of 1 recorded trials" in result.output
    assert "not measured: recordings/P01" in result.stderr


def test_a_refused_export_or_import_creates_no_files(folder, tmp_path):
    assert "the first enrolment creates it" in refuse("study", "export", folder, "-o", tmp_path / "out")
    assert "the first enrolment creates it" in refuse("study", "measure", folder)
    assert "is not an export of a study" in refuse(
        "study", "import", folder, "--store", tmp_path / "other.db"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]
