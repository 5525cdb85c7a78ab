"""The live page in a real browser."""

import pytest

pytestmark = pytest.mark.browser


def test_the_page_follows_the_loop(live, page):
    page.goto(live.url)
    page.wait_for_function("document.body.dataset.index > 20")
    assert page.inner_text("nav a[aria-current=page]") == "Live"
    assert "not a medical device" in page.inner_text("body")
