"""What the pages show when a trial has ended, and when another participant comes."""

import re

import pytest
from live_bench import close_page, evaluate, until
from studying import (
    PROTOCOL,
    Station,
    aligned_source,
    begin,
    experimenter_at,
    participant_at,
    wait_for_stage,
)

pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]


@pytest.fixture
def folder(tmp_path):
    text = PROTOCOL.replace('order = "fixed"', 'order = "fixed"\nblind = "nobody"')
    (tmp_path / "study.toml").write_text(re.sub(r"\[training\][^\[]*|\[\[questionnaire\]\][^\[]*", "", text))
    return tmp_path


def ask(lab, button):
    lab.click(button)
    lab.fill("#reason", "a test")
    lab.click("#confirm")


def test_a_trial_that_has_ended_is_no_frozen_picture_and_leaves_with_its_participant(folder, open_page):
    with Station(folder, aligned_source(folder)) as station:
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        lab.click("#enrol button")
        person.click("text=Continue")
        person.click("text=I agree")
        wait_for_stage(person, "trial/1/1/1")
        begin(person)
        person.wait_for_selector("#keys")
        person.route("**/participant/status", lambda _: None)  # a busy server does not respond
        ask(lab, "#abort")
        until(person, "page.ended")
        person.evaluate("() => { const now_ms = performance.now(); performance.now = () => now_ms + 5000; }")
        until(person, "document.getElementById('trial-status').textContent.startsWith('Finished')")
        assert evaluate(person, "page.status.trial_status") == "running"
        assert person.is_hidden("#banner") and person.is_hidden("#keys")
        close_page(person)

        lab.wait_for_selector("#plan .now:has-text('does not count (a test)')")
        until(lab, "page.status.trial_status === ''")
        assert lab.is_visible("#state") and lab.inner_text("#state")
        ask(lab, "#stop")
        lab.wait_for_selector("#stop", state="hidden")
        lab.click("#enrol button")
        lab.wait_for_selector("#participant:has-text('P02')")
        lab.wait_for_selector("#idle:has-text('During a trial you see here')")
        assert evaluate(lab, "page.hello") is None and lab.is_hidden("#state")
        lab.click("#roster button:has-text('View')")
        lab.wait_for_selector("#ask:has-text('P01 is at this station until you press Leave station')")
        lab.click("#cancel")
        assert lab.inner_text("#participant") == "P02"
        close_page(lab)
