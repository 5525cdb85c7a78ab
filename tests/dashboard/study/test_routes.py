"""The routes of a study from outside: wrong participants, stages and stations, edits, invalid requests."""

import json
import shutil
from contextlib import closing

import pytest
from live_bench import Live
from paths import DATA
from studying import PROTOCOL, Station, feel_pulse, page_with_outputs, rows_of, send_to, study_at

from haptigraph.recording.journal import is_whole
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, EVENTS, SESSIONS, STAGES, TRIALS


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "study.toml").write_text(PROTOCOL)
    return folder


@pytest.fixture(scope="module")
def station(folder, quick_uri):
    with Station(folder, quick_uri) as running:
        yield running


@pytest.fixture
def here(station):
    """Open P01 at this station, whatever came before."""
    snapshot = send_to(station, "/study/status")[1]
    if "P01" not in [each["participant"] for each in snapshot["participants"]]:
        assert send_to(station, "/study/enrol", {"participant": "P01"})[0] == 200
    status, _ = send_to(station, "/study/open", {"participant": "P01", "take_over": True})
    assert status == 200
    return "P01"


def refused(station, path, **content):
    status, answer = send_to(station, path, content)
    assert status == 422 and "\n" not in answer["problem"]
    return answer["problem"]


def at_stage(station, key):
    stage = send_to(station, "/participant/status")[1]["stage"]
    assert stage["key"] == key
    return stage


def test_absent_participants_are_refused(station, here):
    assert "has no participant 'P09'; it has P01" in refused(
        station, "/study/open", participant="P09", take_over=False
    )
    for path, more in {
        "/participant/done": {"key": "briefing"},
        "/participant/answer": {"key": "questionnaire/sus/1", "item": "1", "answer": "3"},
        "/participant/begin": {"key": "trial/1/1/1"},
        "/study/note": {"text": "sits well"},
        "/study/leave": {},
    }.items():
        problem = refused(station, path, participant="P02", **more)
        assert problem == "participant 'P02' is not at this station; P01 is"
    assert "go by a pseudonym" in refused(station, "/study/enrol", participant="Anna Meier")
    assert send_to(station, "/study/status")[1]["current"]["participant"] == "P01"


def test_only_the_next_stage_is_accepted(station, here, folder):
    at_stage(station, "briefing")
    for path, key in (
        ("/participant/done", "consent"),
        ("/participant/begin", "trial/1/1/1"),
        ("/participant/begin", "briefing"),
    ):
        assert "does not come next, but briefing" in refused(station, path, participant=here, key=key)
    assert "trial briefing is not running" in refused(
        station, "/study/abort", participant=here, key="briefing", reason="x"
    )
    assert "is not free training" in refused(
        station, "/participant/ready", participant=here, key="trial/1/1/1"
    )
    assert "does not lie right behind" in refused(
        station, "/study/repeat", participant=here, key="trial/1/1/1", reason="x"
    )
    assert "without a reason" in refused(
        station, "/study/repeat", participant=here, key="trial/1/1/1", reason=" "
    )
    assert "a note needs words" in refused(station, "/study/note", participant=here, text=" ")
    assert rows_of(folder, STAGES, "stage") == [] and rows_of(folder, TRIALS, "trial") == []


@pytest.mark.parametrize(
    ("path", "content"),
    [
        ("/study/open", {"participant": "P01"}),
        ("/study/open", {"participant": 1, "take_over": False}),
        ("/study/note", {"participant": "P01", "text": "x", "kind": "stop"}),
        ("/participant/answer", {"participant": "P01", "key": "k", "item": "1", "answer": 3}),
        ("/participant/answer", b"no json"),
        ("/participant/done", b"[" * 100_000),
    ],
)
def test_an_invalid_request_is_refused(station, path, content):
    status, answer = send_to(station, path, content)
    assert status == 400 and answer["problem"].startswith("invalid request: ")


def test_requests_of_other_origins_are_refused(station, here):
    content = {"participant": here, "text": "x"}
    assert send_to(station, "/study/note", content, Origin="http://evil.example")[0] == 403


def test_a_second_station_must_take_over_and_cuts_off_the_first(station, here, folder):
    with closing(Store(folder / "study.db")) as store:
        study = study_at(folder, store)
        elsewhere = open_session(study, here, "lab 2", take_over=True)
        snapshot = send_to(station, "/study/status")[1]
        assert snapshot["current"] is None and snapshot["participants"][0]["station"] == "lab 2"
        assert send_to(station, "/participant/status")[1]["participant"] == ""
        problem = refused(station, "/participant/done", participant=here, key="briefing")
        assert problem == "participant 'P01' is not at this station; nobody is"
        problem = refused(station, "/study/open", participant=here, take_over=False)
        assert "P01 is at station lab 2 since" in problem and "take it over" in problem
        assert elsewhere.next().stage.key == "briefing"
    assert send_to(station, "/study/open", {"participant": here, "take_over": True})[0] == 200
    open_sessions = [
        row for row in rows_of(folder, SESSIONS, "session", "station", "closed_utc") if row[2] is None
    ]
    assert [name for _, name, _ in open_sessions] == ["lab 1"]


def test_an_acknowledged_answer_is_stored_and_can_be_removed(station, here, folder):
    for key in ("briefing", "consent"):
        assert send_to(station, "/participant/done", {"participant": here, "key": key})[0] == 200
    place = {"participant": here, "key": "questionnaire/demographics"}
    at_stage(station, place["key"])
    for answer in ("30", "31"):
        status, snapshot = send_to(
            station, "/participant/answer", {**place, "item": "age_years", "answer": answer}
        )
        assert status == 200 and snapshot["stage"]["answers"] == {"age_years": answer}
        assert rows_of(folder, ANSWERS, "item", "answer") == [("age_years", answer)]
    problem = refused(station, "/participant/answer", **place, item="age_years", answer="7")
    assert problem == "item 'age_years': expected a number from 18 to 99, found '7'"
    assert send_to(station, "/participant/answer", {**place, "item": "age_years", "answer": ""})[0] == 200
    assert rows_of(folder, ANSWERS, "item") == []
    problem = refused(station, "/participant/done", **place)
    assert "no answer yet to age_years, gender" in problem
    for item in at_stage(station, place["key"])["items"]:
        answer = item["choices"][0] if item["choices"] else "30"
        assert (
            send_to(station, "/participant/answer", {**place, "item": item["key"], "answer": answer})[0]
            == 200
        )
    assert send_to(station, "/participant/done", place)[0] == 200
    at_stage(station, "training/0/0/1")


def test_an_edited_protocol_blocks_all_actions(station, here, folder, request):
    file = folder / "study.toml"
    original = file.read_text()
    request.addfinalizer(lambda: file.write_text(original))
    file.write_text(original.replace("along_mm = 3", "along_mm = 4"))
    key = send_to(station, "/participant/status")[1]["stage"]["key"]
    for path, content in {
        "/study/enrol": {"participant": "P02"},
        "/study/open": {"participant": here, "take_over": False},
        "/participant/begin": {"participant": here, "key": key},
    }.items():
        assert "study short: frozen since" in (problem := refused(station, path, **content)), problem
    file.write_text("[study]\nname = ")
    assert "study.toml, end of document: not valid TOML" in refused(
        station, "/participant/begin", participant=here, key=key
    )
    file.write_text(original)
    assert send_to(station, "/study/status")[1]["current"]["participant"] == here


def test_no_trial_begins_until_an_output_was_felt_and_a_changed_one_is_felt_again(station, here, folder):
    trial = {"participant": here, "key": at_stage(station, "training/0/0/1")["key"]}
    for path in ("/participant/begin", "/participant/pulse"):
        assert refused(station, path, **trial).startswith("there is no haptic output; connect a game con")
    assert "no test pulse was played yet" in refused(station, "/participant/felt", **trial, is_felt=True)
    snapshot = send_to(station, "/study/status")[1]
    assert snapshot["current"]["touch"]["problem"].startswith("there is no haptic output")
    with page_with_outputs(station, "screen") as line:
        while not send_to(station, "/participant/status")[1]["touch"]["output"]:
            assert station.process.poll() is None
        assert "the participant presses Test pulse" in refused(station, "/participant/begin", **trial)
        assert send_to(station, "/participant/pulse", trial)[0] == 200
        edges = [amplitude for _, amplitude, _ in levels(line)]
        assert edges.count(1.0) == 3 and edges[-1] == 0.0  # the guard's, also to the page
        status, answer = send_to(station, "/participant/felt", {**trial, "is_felt": False})
        assert status == 200 and "Test pulse" in answer["touch"]["problem"]
        feel_pulse(station, trial)
        line.send(json.dumps({"type": "outputs", "names": ["controller: Other", "screen"]}))
        while (touch := send_to(station, "/participant/status")[1]["touch"])["output"] == "screen":
            assert station.process.poll() is None
        assert touch["output"] == "controller: Other + screen"
        assert "has changed since the last test pulse" in refused(station, "/participant/begin", **trial)
    assert rows_of(folder, TRIALS, "trial") == []
    texts = rows_of(folder, EVENTS, "kind", "text")
    assert texts == [("felt", "screen"), ("unfelt", "screen")]


def levels(line):
    """Return the levels that a page receives until the server answers its ping."""
    line.send(json.dumps({"type": "ping", "time_ms": 0}))
    edges = []
    while (message := json.loads(line.recv(timeout=10)))["type"] != "pong":
        edges += message.get("edges", [])
    return edges


def test_a_running_trial_blocks_other_sessions_and_trials(station, here, folder):
    key = at_stage(station, "training/0/0/1")["key"]
    trial = {"participant": here, "key": key}
    with page_with_outputs(station, "screen"):
        feel_pulse(station, trial)
        assert send_to(station, "/participant/begin", trial)[1]["trial_status"] == "preparing"
    for path, content in {
        "/participant/begin": trial,
        "/study/leave": {"participant": here},
        "/study/withdraw": {"participant": here},
        "/study/enrol": {"participant": ""},
        "/study/open": {"participant": here, "take_over": False},
    }.items():
        assert "a trial is running at this station" in refused(station, path, **content)
    assert wait_for_trial_status(station, "running")["current"]["stage"]["running"] is True
    assert send_to(station, "/study/note", {"participant": here, "text": "steady hand"})[0] == 200
    assert send_to(station, "/participant/ready", trial)[0] == 200
    snapshot = wait_for_trial_status(station, "")
    assert snapshot["problem"] == "" and snapshot["current"]["repeatable"] == key
    ((name, outcome, recording),) = rows_of(folder, TRIALS, "phase", "outcome", "recording")
    assert (name, outcome) == ("training", "timeout")  # free training: the target was not hit
    assert is_whole(folder / recording)
    texts = rows_of(folder, EVENTS, "kind", "text")
    assert texts == [("felt", "screen"), ("felt", "screen"), ("note", "steady hand"), ("unfelt", "screen")]

    again = {**trial, "reason": "the lens cap was on"}
    assert send_to(station, "/study/repeat", again)[1]["current"]["stage"]["attempt"] == 2
    at_stage(station, key)


def wait_for_trial_status(station, trial_status):
    while (snapshot := send_to(station, "/study/status")[1])["trial_status"] != trial_status:
        assert station.process.poll() is None
    return snapshot


def test_a_signal_ends_trial_session_and_program(station, here, folder):
    """The last test of this station, which the signal stops."""
    trial = {"participant": here, "key": at_stage(station, "training/0/0/1")["key"]}
    with page_with_outputs(station, "screen"):
        feel_pulse(station, trial)
        send_to(station, "/participant/begin", trial)
    wait_for_trial_status(station, "running")
    output = station.stop()
    assert station.process.returncode == 0 and "Traceback" not in output
    assert "P01  training/0/0/1, attempt 2: the trial was aborted: haptigraph was stopped" in output
    rows = rows_of(folder, TRIALS, "attempt", "outcome", "void", "recording")
    assert rows[-1][:3] == (2, "aborted", "haptigraph was stopped")
    assert all(is_whole(folder / recording) for *_, recording in rows)
    assert all(closed_utc for (closed_utc,) in rows_of(folder, SESSIONS, "closed_utc"))


def test_the_live_command_serves_no_study(live: Live):
    assert send_to(live, "/study/status")[0] == 404


def test_a_study_of_version_0_1_opens_on_its_page(quick_uri, tmp_path):
    study = shutil.copytree(DATA / "v0_1" / "study", tmp_path / "study")
    frozen = json.loads((DATA / "v0_1" / "export" / "study.json").read_text())["parts"]
    (study / "subretinal_injection.toml").write_text(frozen["procedure subretinal_injection"])
    with Station(study, quick_uri) as station:
        snapshot = send_to(station, "/study/status")[1]
        assert [each["participant"] for each in snapshot["participants"]] == ["S01", "S02"]
        status, answer = send_to(station, "/study/open", {"participant": "S01", "take_over": False})
        assert status == 200, answer
        assert all(each["ended"] for each in answer["participants"])
