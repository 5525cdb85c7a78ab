"""The theme of all pages: the system's, or the chosen one."""

import pytest
from inspecting import use_theme

pytestmark = pytest.mark.browser

GROUNDS = {"dark": "rgb(14, 19, 23)", "light": "rgb(238, 241, 244)"}


def ground(page):
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def drawn(page):
    """Return the first pixel of the curves: canvases follow the theme too."""
    page.evaluate("() => new Promise((done) => setTimeout(done, 700))")
    return page.evaluate(
        "[...document.getElementById('traces').getContext('2d').getImageData(150, 1, 1, 1).data.slice(0, 3)]"
    )


def test_the_theme_follows_the_system_until_one_is_chosen_and_remembered(live, open_page):
    page = open_page(live.url)
    for theme in ("light", "dark"):
        use_theme(page, theme)
        assert ground(page) == GROUNDS[theme]
        assert (min(drawn(page)) > 200) is (theme == "light")
    page.get_by_label("Theme").select_option("light")
    assert ground(page) == GROUNDS["light"]
    page.goto(f"{live.url}recordings")
    assert ground(page) == GROUNDS["light"]
    assert page.get_by_label("Theme").input_value() == "light"
    page.get_by_label("Theme").select_option("system")
    assert ground(page) == GROUNDS["dark"]
