"""The calibration on the pages: played on request only, once, and answered only after it was played."""

from contextlib import closing

import pytest
from inspecting import axe_violations, layout_problems
from live_bench import close_page, until
from studying import PARTICIPANT, PROTOCOL, Station, page_with_outputs, rows_of, send_to, study_at
from walking import calibrate

from haptigraph.study.runner import Session
from haptigraph.study.store import Store
from haptigraph.study.tables import CALIBRATION, EVENTS, STAGES

TABLE = "\n[calibration]\nstimuli = {stimuli}\npresentations = 1\ntimes_threshold = {times}\n"
WITHOUT_QUESTIONS = PROTOCOL[: PROTOCOL.index('[[questionnaire]]\nfile = "demographics"')]


def new_study(folder, stimuli=20, times=3.0):
    (folder / "study.toml").write_text(WITHOUT_QUESTIONS + TABLE.format(stimuli=stimuli, times=times))
    return folder


@pytest.fixture
def station(tmp_path, quick_uri):
    with Station(new_study(tmp_path), quick_uri) as running:
        send_to(running, "/study/enrol", {"participant": "P01"})
        for key in ("briefing", "consent"):
            send_to(running, "/participant/done", {"participant": "P01", "key": key})
        yield running


def sent(station, action, number, **content):
    content = {"participant": "P01", "key": "calibration/threshold", "number": number, **content}
    status, answer = send_to(station, f"/participant/{action}", content)
    return answer["problem"] if status == 422 else answer


def played(station):
    """Wait until the stimulus is over; return the participant's status."""
    while (status := send_to(station, "/participant/status")[1])["trial_status"]:
        pass
    return status


def test_a_stimulus_is_played_once_and_then_answered(station, tmp_path):
    assert "there is no haptic output" in sent(station, "play", 1)
    with page_with_outputs(station, "controller"):
        send_and_answer(station, tmp_path)


def send_and_answer(station, tmp_path):
    while not send_to(station, "/participant/status")[1]["touch"]["output"]:
        assert station.process.poll() is None
    stage = send_to(station, "/participant/status")[1]["stage"]
    assert (stage["title"], stage["number"], stage["of"], stage["played"]) == (
        "Did you feel it?",
        1,
        20,
        False,
    )
    assert stage["choices"] == ["felt", "not felt"] and not stage["may_learn"]
    answer = {"response": "felt", "page_output": "controller"}
    assert sent(station, "respond", 1, **answer) == "it was not played yet; play it first"
    assert "stimulus 2 of calibration/threshold does not come next" in sent(station, "play", 2)
    assert sent(station, "play", 1)["trial_status"] == "stimulus"
    assert "a vibration is played at this station" in sent(station, "play", 1)
    assert played(station)["stage"]["played"] is True
    assert sent(station, "play", 1) == "it was played already; choose an answer"
    assert "expected felt, not felt" in sent(station, "respond", 1, response="perhaps", page_output="")
    assert sent(station, "respond", 1, **answer)["stage"]["number"] == 2
    assert "does not come next" in sent(station, "respond", 1, **answer)  # a double click
    assert rows_of(tmp_path, CALIBRATION, "number", "device", "page_output") == [(1, "console", "controller")]
    current = send_to(station, "/study/status")[1]["current"]
    assert (current["stage"]["answer_count"], current["stage"]["item_count"]) == (1, 20)


def test_the_experimenter_sees_the_result_or_skips_with_a_reason(station, tmp_path):
    with closing(Store(tmp_path / "study.db")) as store:
        study = study_at(tmp_path, store)
        session = Session(study, "P01", 0, 1)
        calibrate(session, session.next().stage)
    current = send_to(station, "/study/status")[1]["current"]
    assert "0 of 4 catch trials felt; the weakest pattern has amplitude" in current["calibration"]
    assert current["stage"]["title"] == "Which one was it?"
    key = "calibration/patterns"
    learn = {"participant": "P01", "key": key, "number": 1, "pattern": "tickle"}
    assert "unknown pattern 'tickle'" in send_to(station, "/participant/play", learn)[1]["problem"]
    learn["pattern"] = "pulse"
    assert "there is no haptic output" in send_to(station, "/participant/play", learn)[1]["problem"]
    skip = {"participant": "P01", "key": key, "reason": ""}
    assert "not skipped without a reason" in send_to(station, "/study/skip", skip)[1]["problem"]
    answer = send_to(station, "/study/skip", {**skip, "reason": "no time"})[1]
    assert answer["current"]["stage"]["key"] == "training/0/0/1"
    assert rows_of(tmp_path, EVENTS, "text") == [("calibration/patterns skipped: no time",)]


def check(page):
    """The page is accessible, and fits a phone and a laptop."""
    assert axe_violations(page) == []
    for size in ((390, 844), (1280, 720)):
        assert layout_problems(page, size) == []


@pytest.mark.browser
def test_a_participant_names_the_patterns_with_the_keyboard_on_a_controller(tmp_path, quick_uri, open_page):
    with Station(new_study(tmp_path, stimuli=0, times=0.0), quick_uri) as station:
        send_to(station, "/study/enrol", {"participant": "P01"})
        page = open_page(
            f"{station.url}participant", module=PARTICIPANT, ready="page.status && page.isOpen", pad=True
        )
        for key in ("briefing", "consent"):
            until(page, f"document.body.dataset.stage === '{key}'")
            page.click("#text-done")
        until(page, "document.body.dataset.screen === 'calibration'")
        assert page.evaluate("window.rumble") == []  # nothing vibrates by itself
        check(page)
        for _ in range(4):  # a busy page gets its data too late, and stays silent
            page.click("#learn button:nth-of-type(2)")
            until(page, "page.status.trial_status === 'stimulus'")
            until(page, "!document.getElementById('learn').hidden && page.status.trial_status === ''")
            if page.evaluate("window.rumble.some((call) => call.strongMagnitude === 1)"):
                break
        else:
            pytest.fail("the controller did not vibrate")
        for number in (1, 2, 3):
            until(page, f"page.status.stage.number === {number} && !document.getElementById('try').hidden")
            if number == 1:
                page.focus("#try")
            until(page, "document.activeElement.id === 'try'")  # without a mouse
            page.keyboard.press("Enter")
            until(page, "!document.getElementById('choices').hidden")
            assert page.evaluate("document.activeElement.id") == "choices"
            assert page.is_hidden("#try") and page.is_hidden("#learn")
            if number == 1:
                check(page)
            page.keyboard.press("1")
        until(page, "document.body.dataset.stage === 'training/0/0/1'")
        close_page(page)
    rows = rows_of(tmp_path, CALIBRATION, "number", "pattern", "response", "correct", "page_output")
    assert [row[2] for row in rows] == ["low"] * 3
    assert sum(row[3] for row in rows) == 1 and {row[1] for row in rows} == {"low", "pulse", "success"}
    assert {row[4] for row in rows} == {"controller"}
    assert "calibration/patterns" in [stage for (stage,) in rows_of(tmp_path, STAGES, "stage")]
