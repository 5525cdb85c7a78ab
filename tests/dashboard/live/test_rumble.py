"""Haptic feedback on a controller in the browser: follows the patterns, and is silent when anything fails."""

import re
import signal
import sys
import time
from itertools import groupby, pairwise
from pathlib import Path

import pytest
from live_bench import Live, close_page, evaluate, hide, until
from paths import ROOT
from slow_connection import SlowConnection

pytestmark = pytest.mark.browser

SILENT_WITHIN_MS = 200
PATIENT = ("--set", "haptics.deadman_ms=1000")  # else a late image on a busy machine splits a burst
FREEZING = (str(ROOT / "tests" / "dashboard" / "freezing.py"),)


def calls(page):
    return page.evaluate("window.rumble")


def rhythm(calls):
    """Return the levels as letters without repetitions: low, pulse, success, other, - for silence."""
    letters = {(0.3, 0.0): "l", (1.0, 1.0): "p", (0.8, 0.8): "s"}
    played = [
        "-"
        if call["type"] == "reset"
        else letters.get((round(call["strongMagnitude"], 2), round(call["weakMagnitude"], 2)), "o")
        for call in calls
    ]
    return "".join(letter for letter, _ in groupby(played))


def silent_from_ms(calls):
    """Return when the last effect ended [ms since 1970]."""
    end_ms = 0.0
    for call in calls:
        end_ms = (
            min(end_ms, call["at"]) if call["type"] == "reset" else max(end_ms, call["at"] + call["duration"])
        )
    return end_ms


def test_rumble_follows_the_patterns(quick_uri, open_page):
    """The scenario: misaligned, wrong contact, back, aligned, hit."""
    with Live(quick_uri, *PATIENT) as live:
        page = open_page(live.url, pad=True)
        for state in ("outside_eye", "target_hit", "outside_eye"):
            until(page, f"document.body.dataset.state === '{state}'", 60)
        played = rhythm(calls(page))
        close_page(page)
    assert re.search(r"(l-?)+(p-){3,}p?-?(l-?)+(s-){1,2}", played), played  # a busy page may miss the pause
    assert all(burst.count("s") <= 2 for burst in re.findall(r"(?:s-?)+", played)), played
    assert "o" not in played
    assert "sp" not in played and "ps" not in played


@pytest.mark.slow  # `make test` calls the same module without a run
def test_commands_keep_their_distance_and_end_with_the_data(quick_uri, open_page):
    with Live(quick_uri) as live:
        page = open_page(live.url, pad=True)
        until(page, "window.rumble.filter(({ type }) => type === 'dual-rumble').length > 20", 60)
        made = calls(page)
        close_page(page)
    starts = [call["at"] for call in made if call["type"] == "dual-rumble"]
    assert min(after - before for before, after in pairwise(starts)) >= 49
    assert max(call["duration"] for call in made) <= 150
    assert all(call["startDelay"] == 0 for call in made if call["type"] == "dual-rumble")


def test_an_image_that_seems_to_come_from_the_future_prolongs_nothing(live, open_page):
    left_ms = open_page(live.url).evaluate(
        """async () => {
             const { Haptics } = await import('/static/common/haptics.js');
             const haptics = new Haptics(150), left_ms = [];
             haptics.add({ play(_level, until_ms, now_ms) { left_ms.push(until_ms - now_ms); } });
             haptics.setLevel([[0, 1, 80]], 1000);
             haptics.keepAlive(1018, 1000);
             return left_ms.at(-1);
           }"""
    )
    assert left_ms == 150


@pytest.fixture(scope="module")
def steady(quick, tmp_path_factory):
    """A scene in which the needle vibrates steadily."""
    text = Path(quick).read_text().partition("[[move]]")[0]
    path = tmp_path_factory.mktemp("scene") / "steady.toml"
    path.write_text(text + "[[move]]\nduration_s = 600\ndepth_mm = 12.0\ntheta_deg = -6.0\n")
    return f"teleop:{path}"


@pytest.fixture(scope="module")
def steady_live(steady):
    """One server of that scene, for tests that leave it alone."""
    with Live(steady, program=FREEZING) as live:
        yield live


@pytest.fixture
def vibrate(open_page, late_ms):
    """Open a page that vibrates."""

    def open_one(live):
        page = open_page(live.url, pad=True)
        page.late_ms = late_ms
        until(page, "window.rumble.length > 5 && window.rumble.at(-1).strongMagnitude > 0")
        return page

    return open_one


@pytest.fixture
def vibrating_page(steady_live, vibrate):
    page = vibrate(steady_live)
    yield page
    close_page(page)


@pytest.fixture
def vibrating(steady, vibrate):
    """A page that vibrates, and a server of its own, whose source SIGUSR1 freezes."""
    with Live(steady, program=FREEZING) as live:
        page = vibrate(live)
        yield page, live
        close_page(page)


def assert_silent(page, event_ms):
    """Wait until the controller has been silent for half a second, and check when the silence began."""
    until(
        page,
        f"performance.timeOrigin + performance.now() - Math.max({event_ms}, window.rumble.at(-1).at) > 500",
    )
    assert silent_from_ms(calls(page)) - event_ms <= SILENT_WITHIN_MS + page.late_ms(event_ms)


def test_a_killed_server_silences_it(vibrating):
    page, live = vibrating
    event_ms = time.time() * 1000
    live.process.kill()
    assert_silent(page, event_ms)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_hanging_server_silences_it(vibrating):
    page, live = vibrating
    event_ms = time.time() * 1000
    live.process.send_signal(signal.SIGSTOP)
    try:
        assert_silent(page, event_ms)
        page.wait_for_selector("#banner:has-text('No data received')")
    finally:
        live.process.send_signal(signal.SIGCONT)


def test_a_tip_that_is_not_visible_silences_it_and_page_and_terminal_say_so(vibrating):
    page, live = vibrating
    event_ms = time.time() * 1000
    live.process.send_signal(signal.SIGUSR2)
    assert_silent(page, event_ms)
    explanation = "the needle is seen, its tip is not. Haptic output is off."
    page.wait_for_selector(f"#banner:has-text('Tip not visible') span:text-is('{explanation}')")
    assert page.inner_text("#state").lower() == "tip not visible"
    assert "tip not visible" in page.locator("#diagram .node.on title").text_content()
    output = live.stop()
    assert re.search(r" s  tip_not_visible +the needle is seen, its tip is not\n", output)
    assert re.search(r"tip +not visible in \d+ of \d+ steps", output)


def test_a_frozen_source_silences_it_and_raises_the_banner(vibrating):
    page, live = vibrating
    event_ms = time.time() * 1000
    live.process.send_signal(signal.SIGUSR1)
    assert_silent(page, event_ms)
    page.wait_for_selector("#banner:has-text('No image'):has-text('stale image')")
    assert page.inner_text("#state").lower() == "unknown"


@pytest.mark.parametrize("delay_s", [0.2, pytest.param(2.0, marks=pytest.mark.slow)])
def test_images_that_come_too_late_are_not_felt_and_the_banner_says_so(steady_live, open_page, delay_s):
    live = steady_live
    port = int(live.url.split(":")[2].split("/")[0])
    with SlowConnection(port, delay_s) as slow:
        page = open_page(live.url.replace(str(port), str(slow), 1), pad=True)
        banner = "#banner:has-text('Connection too slow'):has-text('haptic feedback stops after 150 ms')"
        page.wait_for_selector(banner, timeout=60_000)
        number = evaluate(page, "page.header.number")
        until(page, f"page.header.number > {number} + 5")
        assert not any(call["type"] == "dual-rumble" for call in calls(page))
        close_page(page)


def test_a_hidden_page_is_silent_at_once(vibrating_page):
    page = vibrating_page
    event_ms = time.time() * 1000
    hide(page)
    assert_silent(page, event_ms)
    assert calls(page)[-1]["type"] == "reset"


def test_a_closed_page_is_silent_at_once(vibrating_page):
    page = vibrating_page
    page.evaluate("dispatchEvent(new PageTransitionEvent('pagehide'))")
    assert page.evaluate("window.rumble.find((call, at) => call.type === 'reset' && at > 5)")


def test_a_blocked_page_falls_silent(vibrating_page):
    """Effects end by themselves, because a page whose thread is busy cannot stop them."""
    page = vibrating_page
    event_ms = page.evaluate(
        """() => { const from = performance.timeOrigin + performance.now();
             while (performance.timeOrigin + performance.now() < from + 400); return from; }"""
    )
    before = [call for call in calls(page) if call["at"] <= event_ms]
    assert silent_from_ms(before) - event_ms <= SILENT_WITHIN_MS + page.late_ms(event_ms)


def test_the_controller_can_be_switched_off(vibrating_page):
    page = vibrating_page
    page.locator("#outputs").get_by_label("controller").uncheck()
    count = len(calls(page))
    assert calls(page)[-1]["type"] == "reset"
    index = evaluate(page, "page.header.index")
    until(page, f"page.header.index > {index} + 10")
    assert len(calls(page)) == count


def test_border_and_tone_replace_a_controller(vibrating_page):
    page = vibrating_page
    page.evaluate(
        """() => { window.tones = [];
             const set = AudioParam.prototype.setTargetAtTime;
             AudioParam.prototype.setTargetAtTime = function (value, ...more) { window.tones.push(value); return set.call(this, value, ...more); }; }"""
    )
    page.locator("#outputs").get_by_label("screen").check()
    page.locator("#outputs").get_by_label("sound").check()
    until(page, "document.body.classList.contains('vibrating')")
    until(page, "window.tones.some((value) => Math.abs(value - 0.4 * 0.3) < 1e-6)")
    page.locator("#outputs").get_by_label("sound").uncheck()
    assert page.evaluate("window.tones.at(-1)") == 0
    page.locator("#outputs").get_by_label("screen").uncheck()
    assert not page.evaluate("document.body.classList.contains('vibrating')")


def test_rumble_keeps_its_gap_for_any_sequence_of_levels(live, open_page):
    page = open_page(live.url)
    gaps = page.evaluate(
        """async () => {
             const { Rumble } = await import('/static/live/rumble.js');
             const at = [];
             const pad = { vibrationActuator: { playEffect() { at.push(performance.now()); }, reset() {} } };
             const rumble = new Rumble(() => pad);
             const end = performance.now() + 1000;
             while (performance.now() < end) {
               const now = performance.now();
               rumble.play({ amplitude: Math.random() < 0.4 ? 0 : Math.random(), frequency_hz: 80 }, now + 150, now);
               await new Promise((go) => setTimeout(go, 1 + 12 * Math.random()));
             }
             return at.slice(1).map((then, number) => then - at[number]);
           }"""
    )
    assert len(gaps) > 5
    assert min(gaps) >= 49.5
