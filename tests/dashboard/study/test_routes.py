"""The routes of a study as anyone meets them: wrong participants, stages and stations, edits, nonsense."""

from contextlib import closing

import pytest
from live_bench import Live
from studying import PROTOCOL, Station, ask_at, rows_of, study_at

from haptigraph.recording.journal import is_whole
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, EVENTS, SESSIONS, STAGES, TRIALS

pytestmark = pytest.mark.xdist_group("server")


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
    """P01, at this station, whatever came before."""
    now = ask_at(station, "/study/now")[1]
    if "P01" not in [each["participant"] for each in now["participants"]]:
        assert ask_at(station, "/study/enrol", {"participant": "P01"})[0] == 200
    status, _ = ask_at(station, "/study/open", {"participant": "P01", "take_over": True})
    assert status == 200
    return "P01"


def refused(station, path, **content):
    status, answer = ask_at(station, path, content)
    assert status == 422 and "\n" not in answer["problem"]
    return answer["problem"]


def at_stage(station, key):
    stage = ask_at(station, "/participant/now")[1]["stage"]
    assert stage["key"] == key
    return stage


def test_who_is_not_there_is_told(station, here):
    assert "has no participant 'P09'; it has 1" in refused(
        station, "/study/open", participant="P09", take_over=False
    )
    for path, more in {
        "/participant/done": {"key": "briefing"},
        "/participant/answer": {"key": "questionnaire/sus/1", "item": "1", "answer": "3"},
        "/participant/begin": {"key": "trial/1/1/1"},
        "/study/note": {"text": "sits well"},
        "/study/leave": {},
    }.items():
        told = refused(station, path, participant="P02", **more)
        assert told == "participant 'P02' is not at this station; P01 is"
    assert "go by a pseudonym" in refused(station, "/study/enrol", participant="Anna Meier")
    assert ask_at(station, "/study/now")[1]["here"]["participant"] == "P01"


def test_a_stage_that_does_not_come_next_is_not_skipped_into(station, here, folder):
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
    assert "is no free training" in refused(
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
def test_nonsense_is_refused(station, path, content):
    status, answer = ask_at(station, path, content)
    assert status == 400 and answer["problem"].startswith("not understood: ")


def test_pages_from_elsewhere_do_nothing(station, here):
    content = {"participant": here, "text": "x"}
    assert ask_at(station, "/study/note", content, Origin="http://evil.example")[0] == 403


def test_a_second_station_is_refused_until_it_takes_over_and_then_the_first_is_cut_off(station, here, folder):
    with closing(Store(folder / "study.db")) as store:
        study = study_at(folder, store)
        elsewhere = open_session(study, here, "lab 2", take_over=True)
        now = ask_at(station, "/study/now")[1]
        assert now["here"] is None and now["participants"][0]["station"] == "lab 2"
        assert ask_at(station, "/participant/now")[1]["participant"] == ""
        told = refused(station, "/participant/done", participant=here, key="briefing")
        assert told == "participant 'P01' is not at this station; nobody is"
        told = refused(station, "/study/open", participant=here, take_over=False)
        assert "P01 is at station lab 2 since" in told and "take it over" in told
        assert elsewhere.next().stage.key == "briefing"
    assert ask_at(station, "/study/open", {"participant": here, "take_over": True})[0] == 200
    open_sessions = [
        row for row in rows_of(folder, SESSIONS, "session", "station", "closed_utc") if row[2] is None
    ]
    assert [name for _, name, _ in open_sessions] == ["lab 1"]


def test_an_answer_is_in_the_store_when_it_is_acknowledged_and_can_be_taken_back(station, here, folder):
    for key in ("briefing", "consent"):
        assert ask_at(station, "/participant/done", {"participant": here, "key": key})[0] == 200
    place = {"participant": here, "key": "questionnaire/demographics"}
    at_stage(station, place["key"])
    for answer in ("30", "31"):
        status, now = ask_at(station, "/participant/answer", {**place, "item": "age_years", "answer": answer})
        assert status == 200 and now["stage"]["answers"] == {"age_years": answer}
        assert rows_of(folder, ANSWERS, "item", "answer") == [("age_years", answer)]
    told = refused(station, "/participant/answer", **place, item="age_years", answer="7")
    assert told == "item 'age_years': expected a number from 18 to 99, found '7'"
    assert ask_at(station, "/participant/answer", {**place, "item": "age_years", "answer": ""})[0] == 200
    assert rows_of(folder, ANSWERS, "item") == []
    told = refused(station, "/participant/done", **place)
    assert "no answer yet to age_years, gender" in told
    for item in at_stage(station, place["key"])["items"]:
        answer = item["choices"][0] if item["choices"] else "30"
        assert (
            ask_at(station, "/participant/answer", {**place, "item": item["key"], "answer": answer})[0] == 200
        )
    assert ask_at(station, "/participant/done", place)[0] == 200
    at_stage(station, "training/0/0/1")


def test_while_the_protocol_is_edited_nothing_begins(station, here, folder, request):
    file = folder / "study.toml"
    sound = file.read_text()
    request.addfinalizer(lambda: file.write_text(sound))
    file.write_text(sound.replace("along_mm = 3", "along_mm = 4"))
    key = ask_at(station, "/participant/now")[1]["stage"]["key"]
    for path, content in {
        "/study/enrol": {"participant": "P02"},
        "/study/open": {"participant": here, "take_over": False},
        "/participant/begin": {"participant": here, "key": key},
    }.items():
        assert "study short: frozen since" in (told := refused(station, path, **content)), told
    file.write_text("[study]\nname = ")
    assert "study.toml, end of document: not valid TOML" in refused(
        station, "/participant/begin", participant=here, key=key
    )
    file.write_text(sound)
    assert ask_at(station, "/study/now")[1]["here"]["participant"] == here


def test_one_trial_at_a_time_and_meanwhile_nobody_comes_or_goes(station, here, folder):
    key = at_stage(station, "training/0/0/1")["key"]
    trial = {"participant": here, "key": key}
    assert ask_at(station, "/participant/begin", trial)[1]["doing"] == "preparing"
    for path, content in {
        "/participant/begin": trial,
        "/study/leave": {"participant": here},
        "/study/withdraw": {"participant": here},
        "/study/enrol": {"participant": ""},
        "/study/open": {"participant": here, "take_over": False},
    }.items():
        assert "a trial is going on at this station" in refused(station, path, **content)
    assert wait_until(station, "running")["here"]["stage"]["running"] is True
    assert ask_at(station, "/study/note", {"participant": here, "text": "steady hand"})[0] == 200
    assert ask_at(station, "/participant/ready", trial)[0] == 200
    now = wait_until(station, "")
    assert now["problem"] == "" and now["here"]["repeatable"] == key
    ((name, outcome, recording),) = rows_of(folder, TRIALS, "phase", "outcome", "recording")
    assert (name, outcome) == ("training", "timeout")  # free training: the target was not hit
    assert is_whole(folder / recording)
    assert rows_of(folder, EVENTS, "kind", "text") == [("note", "steady hand")]

    again = {**trial, "reason": "the lens cap was on"}
    assert ask_at(station, "/study/repeat", again)[1]["here"]["stage"]["attempt"] == 2
    at_stage(station, key)


def wait_until(station, doing):
    while (now := ask_at(station, "/study/now")[1])["doing"] != doing:
        assert station.process.poll() is None
    return now


def test_a_signal_ends_trial_session_and_program_in_order(station, here, folder):
    """The last of this station: it ends by the signal."""
    key = at_stage(station, "training/0/0/1")["key"]
    ask_at(station, "/participant/begin", {"participant": here, "key": key})
    wait_until(station, "running")
    told = station.stop()
    assert station.process.returncode == 130 and "Traceback" not in told
    assert "P01  training/0/0/1, attempt 2: the trial was aborted: haptigraph was stopped" in told
    rows = rows_of(folder, TRIALS, "attempt", "outcome", "void", "recording")
    assert rows[-1][:3] == (2, "aborted", "haptigraph was stopped")
    assert all(is_whole(folder / recording) for *_, recording in rows)
    assert all(closed_utc for (closed_utc,) in rows_of(folder, SESSIONS, "closed_utc"))


def test_the_live_command_serves_no_study(live: Live):
    assert ask_at(live, "/study/now")[0] == 404
