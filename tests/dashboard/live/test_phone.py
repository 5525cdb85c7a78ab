"""A phone's own motor: it follows the level if its user wants it, and is silent in time after any fault of the page."""

import signal
import sys
import time

import pytest
from live_bench import Live, close_page, evaluate, hide, show, until
from paths import DATA

pytestmark = pytest.mark.browser

SILENT_WITHIN_MS = 150 + 10  # the page's estimate of the server's clock is off by some milliseconds
BUZZES = "window.buzz.at(-1)?.pattern[0] > 0"


@pytest.fixture
def held(open_page, late_ms):
    """A page on a phone during steady guidance, and its server; the motor is off as yet."""
    with Live(f"phantom:{DATA / 'steady.toml'}") as live:
        page = open_page(live.url, phone=True, size=(390, 844))
        page.late_ms = late_ms
        until(page, "document.body.dataset.state === 'misaligned_intraocular_navigation'")
        yield page, live
        close_page(page)


def silent_from_ms(page):
    """Return when the motor stops after the last call, if it has not been stopped before [ms since 1970]."""
    last = page.evaluate("window.buzz.at(-1)")
    return last["at"] + sum(last["pattern"])


def buzz_again(page):
    page.evaluate("() => { window.buzz = []; }")
    until(page, BUZZES)


def assert_silent(page, event_ms):
    """Wait for half a second without a call, and check when the motor stopped."""
    until(
        page,
        f"performance.timeOrigin + performance.now() - Math.max({event_ms}, window.buzz.at(-1).at) > 500",
    )
    assert silent_from_ms(page) - event_ms <= SILENT_WITHIN_MS + page.late_ms(event_ms)


def test_the_motor_plays_the_level_only_when_it_is_switched_on(held):
    page, _ = held
    index = evaluate(page, "page.header.index")
    until(page, f"page.header.index > {index} + 10")
    assert page.evaluate("window.buzz") == []
    page.get_by_label("phone").check()
    until(page, "window.buzz.some((call) => call.pattern.length > 3)")
    pattern = page.evaluate("window.buzz.find((call) => call.pattern.length > 3).pattern")
    assert pattern[:3] == [20, 40, 20]  # 30 % is the shortest buzz of each 60 ms
    assert sum(pattern) <= 150
    page.get_by_label("phone").uncheck()
    assert page.evaluate("window.buzz.at(-1).pattern") == [0]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_hidden_locked_left_or_disconnected_it_is_silent_in_time(held):
    page, live = held
    page.get_by_label("phone").check()
    for event in ("freeze", "pagehide"):
        buzz_again(page)
        target = "document" if event == "freeze" else "window"
        stopped = page.evaluate(
            f"() => {{ {target}.dispatchEvent(new Event('{event}')); return window.buzz.at(-1).pattern; }}"
        )
        assert stopped == [0], event
    buzz_again(page)
    event_ms = time.time() * 1000
    hide(page)  # another tab, another app, or the lock screen
    assert_silent(page, event_ms)
    assert page.evaluate("window.buzz.at(-1).pattern") == [0]
    show(page)
    buzz_again(page)
    for how in (signal.SIGSTOP, signal.SIGKILL):  # nothing arrives any more; the connection breaks
        event_ms = time.time() * 1000
        live.process.send_signal(how)
        assert_silent(page, event_ms)
        live.process.send_signal(signal.SIGCONT)
        if how == signal.SIGSTOP:
            buzz_again(page)


def test_a_phone_without_a_motor_and_a_computer_have_no_such_switch(live, open_page):
    page = open_page(live.url)
    assert page.get_by_label("phone").count() == 0
