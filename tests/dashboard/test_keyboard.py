"""Three sessions by keyboard alone, from opening the page to the result."""

import re

import pytest
from inspecting import tab_to
from live_bench import Live, close_page, evaluate, until
from paths import DATA
from playwright.sync_api import expect
from registering import write_eye
from studying import PARTICIPANT, PROTOCOL, STUDY, Station, align, rows_of

from haptigraph.registration.loading import load_registration
from haptigraph.study.tables import EVENTS, TRIALS

pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]


@pytest.fixture
def steered(tmp_path):
    """A scenario that ends, at first, 14 mm deep in the eye and off the target by an angle."""

    def write(theta_deg):
        text = (
            (DATA / "steered.toml")
            .read_text()
            .replace("theta_deg = -6.0", f"theta_deg = {theta_deg}")
            .replace("depth_mm = 8.0", "depth_mm = 14.0")
        )
        path = tmp_path / "steered.toml"
        path.write_text(text)
        return f"teleop:{path}"

    return write


def hold(page, key, condition):
    """Hold a key until a condition is true; again if the page lost its data on a busy machine."""
    for patience_s in (15, 30):
        page.keyboard.down(key)
        try:
            return until(page, condition, patience_s)
        except Exception:
            header = evaluate(page, "page.header")
        finally:
            page.keyboard.up(key)
    raise AssertionError(header)


def test_the_needle_is_steered_to_the_target(steered, open_page):
    with Live(steered(-4.0)) as live:
        page = open_page(live.url)
        tab_to(page, "#hint button")
        page.keyboard.press("Enter")
        assert page.locator("#hint").count() == 0
        align(page)
        hold(page, "ArrowDown", "page.header.state === 'target_hit'")
        assert page.inner_text("#state").lower() == "target hit"
        close_page(page)


def test_a_registration_is_corrected_saved_and_overwritten(archive, quick, tmp_path, chromium):
    out = tmp_path / "made.toml"
    context = chromium.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    page.goto(f"{archive.url}registration")
    tab_to(page, "#source-input")
    page.keyboard.press("Control+a")
    page.keyboard.type(str(write_eye(tmp_path, quick)))
    page.keyboard.press("Enter")
    expect(page.locator("#verdict")).to_have_text(re.compile("^Valid registration"), timeout=90_000)
    tab_to(page, "[data-key=target]")
    before = page.locator("[data-key=target]").get_attribute("aria-label")
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    assert page.locator("[data-key=target]").get_attribute("aria-label") != before
    for expected in ("Saved: ", "already exists"):
        tab_to(page, "#path")
        page.keyboard.press("Control+a")
        page.keyboard.type(str(out))
        expect(page.locator("#save-button")).to_be_enabled()
        page.keyboard.press("Enter")
        expect(page.locator(":is(#verdict, #exists-title)", has_text=expected)).to_be_visible()
    expect(page.get_by_role("button", name="Keep file")).to_be_focused()
    out.write_text("replaced below")
    tab_to(page, "#exists [value=overwrite]")
    with page.expect_response("**/registration/save"):
        page.keyboard.press("Enter")
    expect(page.locator("#exists")).to_be_hidden()
    expect(page.locator("#verdict")).to_have_text(re.compile("^Saved: "))
    load_registration(out)
    context.close()


def test_a_participant_is_taken_through_a_trial(steered, open_page, tmp_path):
    short = re.sub(r"\[training\][^\[]*|\[\[questionnaire\]\][^\[]*", "", PROTOCOL)
    (tmp_path / "study.toml").write_text(short)
    with Station(tmp_path, steered(0.0)) as station:
        lab = open_page(station.url, module=STUDY, ready="page.status")
        person = open_page(
            f"{station.url}participant",
            module=PARTICIPANT,
            ready="page.status && page.isOpen",
            pad=True,
        )
        tab_to(lab, "#pseudonym")
        lab.keyboard.type("P07")
        lab.keyboard.press("Enter")
        for stage in ("briefing", "consent"):
            until(person, f"document.body.dataset.stage === '{stage}'")
            tab_to(person, "#text-done")
            person.keyboard.press("Enter")
        until(person, "document.body.dataset.stage.startsWith('trial')")
        person.wait_for_selector("#pulse:visible")
        for button in ("#pulse", "#felt", "#begin"):
            expect(person.locator(button)).to_be_enabled()
            tab_to(person, button)
            person.keyboard.press("Enter")
        until(person, "page.status.trial_status === 'running' && page.header?.index > 3")
        tab_to(lab, "#note-text")
        lab.keyboard.type("began by keyboard")
        lab.keyboard.press("Enter")
        hold(
            person,
            "ArrowDown",
            "page.header.state === 'target_hit' || page.status.trial_status !== 'running'",
        )
        until(person, "document.body.dataset.stage.startsWith('break')")
        close_page(lab)
        close_page(person)
    assert rows_of(tmp_path, TRIALS, "participant", "outcome", "void") == [("P07", "hit", None)]
    events = [("felt", "controller: Test controller"), ("note", "began by keyboard")]
    assert rows_of(tmp_path, EVENTS, "kind", "text") == events
