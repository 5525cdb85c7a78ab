"""A participant completes a whole study in real browsers; server and browser are killed on the way."""

import re

import pytest
from live_bench import close_page, evaluate, until
from studying import (
    PROTOCOL,
    Station,
    align,
    aligned_source,
    answer_all,
    begin,
    close_study,
    experimenter_at,
    kill,
    participant_at,
    push_to_the_target,
    rows_of,
    wait_for_stage,
)

from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.recording.reader import RunReader
from haptigraph.study.protocol import load_protocol
from haptigraph.study.recordings import recorded_trials, recording_problem
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, EVENTS, PARTICIPANTS, SESSIONS, STAGES, TRIALS

pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]

SUS = "document.querySelectorAll('.item.is-saved').length"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "study.toml").write_text(PROTOCOL)
    return tmp_path


@pytest.fixture
def source(tmp_path):
    return aligned_source(tmp_path)


def vibrate(person):
    """Turn the needle aside until the controller has vibrated for some time."""
    person.keyboard.down("ArrowRight")
    until(person, "page.header.measures.theta_deg > 3")
    person.keyboard.up("ArrowRight")
    until(
        person,
        "window.rumble.filter(({ strongMagnitude }) => Math.abs(strongMagnitude - 0.3) < 0.01).length > 5",
    )


def test_a_participant_completes_the_study_and_crashes_lose_nothing(folder, source, open_page):
    with Station(folder, source) as station:
        port = station.port
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        assert person.is_visible("#wait")
        lab.wait_for_selector("#idle:has-text('During a trial you see here the eye')")
        lab.click("#enrol button")
        wait_for_stage(person, "briefing")
        assert person.locator("#text-body p").all_inner_texts() == ["Steer the needle.", "Hit the target."]
        person.keyboard.press("Tab")  # from the heading, which has the focus
        person.keyboard.press("Enter")
        person.click("text=I agree")
        wait_for_stage(person, "questionnaire/demographics")

        person.click("text=Submit")
        until(person, "document.activeElement.closest('.item')?.dataset.item === 'age_years'")
        person.keyboard.type("7")
        person.keyboard.press("Tab")
        person.wait_for_selector("[data-item=age_years].is-invalid:has-text('a number from 18 to 99')")
        answer_all(person)
        person.click("text=Submit")
        wait_for_stage(person, "training/0/0/1")
        begin(person)
        lab.wait_for_selector("#stage:has-text('Training · Detection and touch')")
        person.keyboard.down("ArrowDown")
        until(person, "page.header.hand?.engaged")
        person.keyboard.up("ArrowDown")
        person.click("#finish")

        wait_for_stage(person, "trial/1/1/1")
        assert person.inner_text("#trial-condition") == "condition 1"  # blinded
        begin(person)
        until(lab, "document.querySelector('#plan .now').textContent.includes('Detection and touch')")
        until(lab, "page.header?.index > 30")  # the recorder may lag behind the page on a busy machine
        kill(station)  # in the middle of a trial, and the browser with it
    close_page(lab)
    close_page(person)
    open_page.close_all()

    with Station(folder, source, "--port", port) as station:
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        assert person.is_visible("#wait")
        lab.click("#roster button:has-text('Resume')")
        wait_for_stage(person, "trial/1/1/1")
        assert evaluate(person, "page.status.stage.attempt") == 2
        lab.wait_for_selector("#plan .now:has-text('does not count (interrupted)')")
        begin(person)
        vibrate(person)
        align(person)
        push_to_the_target(person)

        wait_for_stage(person, "questionnaire/sus/1")
        for number in (1, 2, 3):
            person.click(f"[data-item='{number}'] label:has-text('2')")
        until(person, f"{SUS} === 3")
        kill(station)  # in the middle of a questionnaire
        until(person, "!page.isOpen")
        person.click("[data-item='4'] label:has-text('5')")
        person.wait_for_selector("[data-item='4']:has-text('not saved yet')")
    assert len(rows_of(folder, ANSWERS, "item")) == 8 + 3

    with Station(folder, source, "--port", port) as station:  # the pages reconnect by themselves
        person.wait_for_selector("#wait:visible")
        lab.click("#roster button:has-text('Resume')")
        person.wait_for_selector("[data-item='4'].is-saved")
        close_page(person)  # and now the browser
        person = participant_at(station, open_page)
        until(person, f"{SUS} === 4")
        answer_all(person)
        person.click("text=Submit")
        wait_for_stage(person, "break/2")
        person.click("text=Continue")
        wait_for_stage(person, "trial/2/1/1")
        begin(person)
        lab.click("#abort")
        lab.fill("#reason", "the phone rang")
        lab.click("#confirm")
        lab.wait_for_selector("#plan .now:has-text('the phone rang')")
        until(person, "page.status.trial_status === '' && page.status.stage.attempt === 2")
        lab.fill("#note-text", "asked what the cross is")
        lab.keyboard.press("Enter")
        lab.wait_for_selector("#notes li:has-text('asked what')")
        begin(person)
        close_page(person)  # the browser alone, in the middle of a trial
        person = participant_at(station, open_page)
        until(person, "page.status.trial_status === 'running' && page.header?.index > 3")
        push_to_the_target(person)
        wait_for_stage(person, "questionnaire/sus/2")
        answer_all(person)
        person.click("text=Submit")
        wait_for_stage(person, "thanks")
        person.click("text=Finish")
        close_study(lab, person, station, open_page)
    check(folder)


def test_enrolling_is_not_the_next_step_while_somebody_is_here_and_asks_first(folder, source, open_page):
    with Station(folder, source) as station:
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        assert lab.locator("button.primary:visible").all_inner_texts() == ["Enrol"]
        lab.click("#enrol button")
        lab.wait_for_selector("#participant:has-text('P01')")
        lab.click("#enrol button")
        lab.wait_for_selector("#ask:has-text('Enrolled but without consent: P01.')")
        lab.click("#cancel")
        lab.click("#unenrol")
        lab.click("#confirm")
        lab.wait_for_selector("#participant:empty", state="attached")
        assert rows_of(folder, PARTICIPANTS, "participant") == []
        lab.click("#enrol button")
        person.click("text=Continue")
        person.click("text=I agree")
        lab.wait_for_selector("#detail:has-text('stage 3')")
        assert "Enrol" not in lab.locator("button.primary:visible").all_inner_texts()
        assert lab.is_hidden("#unenrol")
        lab.click("#enrol button")
        lab.wait_for_selector("#ask:has-text('P01 leaves this station and may come back.')")
        lab.click("#cancel")
        assert len(rows_of(folder, PARTICIPANTS, "participant")) == 1
        assert lab.inner_text("#participant") == "P01"
        lab.click("#enrol button")
        lab.click("#confirm")
        lab.wait_for_selector("#participant:has-text('P02')")
        close_page(lab)
        close_page(person)


def check(folder):
    """Check that the store holds everything that was done above, once."""
    done = ["briefing", "consent", "questionnaire/demographics", "questionnaire/sus/1", "break/2"]
    stages = [stage for (stage,) in rows_of(folder, STAGES, "stage")]
    assert stages == sorted([*done, "questionnaire/sus/2", "thanks"])
    trials = rows_of(
        folder, TRIALS, "phase", "position", "attempt", "condition", "outcome", "void", "session"
    )
    assert trials == [
        ("training", 0, 1, "felt", "timeout", None, 1),
        ("trial", 1, 1, "felt", "aborted", "interrupted", 1),
        ("trial", 1, 2, "felt", "hit", None, 2),
        ("trial", 2, 1, "seen", "aborted", "the phone rang", 3),
        ("trial", 2, 2, "seen", "hit", None, 3),
    ]
    answers = rows_of(folder, ANSWERS, "position", "questionnaire", "item", "answer", "session")
    assert len(answers) == 8 + 10 + 10
    first = {item: (answer, session) for at, _, item, answer, session in answers if at == 1}
    assert {item: first[item] for item in "1234"} == dict.fromkeys("123", ("2", 2)) | {"4": ("5", 3)}
    assert {answer for at, _, _, answer, _ in answers if at == 2} == {"5"}
    assert ("age_years", "33") in {(item, answer) for _, _, item, answer, _ in answers}
    felt = ("felt", "controller: Test controller")
    texts = rows_of(folder, EVENTS, "kind", "text")
    assert texts == [felt, felt, felt, ("note", "asked what the cross is")]  # once a session
    assert len(rows_of(folder, PARTICIPANTS, "participant")) == 1
    closed = [closed_utc is not None for _, closed_utc in rows_of(folder, SESSIONS, "session", "closed_utc")]
    assert closed == [True, True, True]  # the last by the end of the program

    store = Store(folder / "study.db")
    recorded = recorded_trials(store, "short")
    store.close()
    assert len(recorded) == 4  # all but the one that was cut off
    assert [problem for trial in recorded if (problem := recording_problem(trial, folder))] == []
    hit = next(trial for trial in recorded if trial["position"] == 2 and trial["outcome"] == "hit")
    felt = next(trial for trial in recorded if trial["position"] == 1 and trial["outcome"] == "hit")
    delivered = {
        name: measure_recording(folder / trial["recording"])
        for name, trial in (("seen", hit), ("felt", felt))
    }
    assert "touch_output" not in delivered["seen"]
    assert delivered["felt"]["touch_output"] == "controller: Test controller"
    assert delivered["felt"]["delivered_s"] > 0
    assert any(capture.delivered for capture, _ in RunReader(folder / felt["recording"]).records(images=()))
    run = RunReader(folder / hit["recording"])
    assert (run.info.participant, run.info.trial) == ("P01", "trial/2/1/1/2")
    assert any(step.conclusion.state == "target_hit" for _, step in run.records())
    assert load_protocol(folder).target(hit["target"]).along_mm in (-2, 3)
    cut_off = RunReader(folder / "recordings" / "P01" / "trial-1-1-1-attempt1.mcap")
    assert not cut_off.is_whole and sum(1 for _ in cut_off.records()) > 3  # up to the last write


def test_blinded_pages_show_no_condition_and_mark_the_port_until_the_needle_is_in(folder, source, open_page):
    file = folder / "aligned.toml"
    file.write_text(file.read_text().replace("depth_mm = 14.0", "depth_mm = -3.0"))
    text = (
        (folder / "study.toml").read_text().replace('order = "fixed"', 'order = "fixed"\nblind = "everyone"')
    )
    (folder / "study.toml").write_text(re.sub(r"\[training\][^\[]*|\[\[questionnaire\]\][^\[]*", "", text))
    with Station(folder, source) as station:
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        lab.click("#enrol button")
        person.click("text=Continue")
        person.click("text=I agree")
        wait_for_stage(person, "trial/1/1/1")
        wait_for_stage(lab, "trial/1/1/1")
        assert lab.inner_text("#stage") == "Trial · condition 1"
        assert lab.inner_text("#idle").endswith("During a trial you see here the eye with the instrument.")
        for page in (lab, person):
            assert "Detection" not in page.inner_text("body")
        for selector in ("#state", "#feels", "#amplitude", "#traces", "#overlays", "#procedure"):
            assert lab.is_hidden(selector)
        begin(person)
        person.wait_for_selector("#trial-status:has-text('Trial: enter through the marked port')")
        until(lab, "page.header?.has_picture")
        lab.wait_for_selector("#view")
        assert evaluate(lab, "[page.hello.procedure.relations, page.header.found, page.header.state]") == [
            [],
            {},
            "",
        ]
        person.keyboard.down("ArrowDown")
        until(person, "document.getElementById('trial-status').textContent === 'Trial'")
        person.keyboard.up("ArrowDown")
        close_page(lab)
        close_page(person)
