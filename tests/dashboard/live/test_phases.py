"""Phases of the operation, entered on the page by button and by key."""

import pytest
from live_bench import Live, until

pytestmark = pytest.mark.browser


@pytest.fixture
def phased(open_page, quick_uri):
    with Live(quick_uri, "--procedure", "subretinal_injection_phases") as live:
        page = open_page(live.url)
        page.live = live
        page.wait_for_selector("#phases button[aria-pressed=true]")
        yield page
        open_page.close_all()  # while the server still runs


def wait_in(page, phase):
    until(page, f"page.header.nodes.includes('{phase.replace(' ', '_')}')")
    page.wait_for_selector(f"#phases button[aria-pressed=true]:text-is('{phase}')")
    assert page.locator("#phases button[aria-pressed=true]").count() == 1


def test_a_phase_is_entered_by_button_and_by_key_and_shown_to_every_viewer(phased, open_page):
    other = open_page(phased.live.url)
    first, second, third, *_ = phased.locator("#phases button").all_inner_texts()
    wait_in(other, first)
    phased.locator("#phases button", has_text=second).click()
    wait_in(phased, second)
    wait_in(other, second)
    other.keyboard.press("3")
    wait_in(phased, third)
