"""One browser for all tests, a fresh page for each. Skipped, and told so, where Chromium is absent."""

import re

import pytest
from live_bench import CHROMIUM, PAD, Live, until
from live_bench import chromium as start_chromium


@pytest.fixture(scope="session")
def chromium():
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with start_chromium() as browser:
        yield browser


@pytest.fixture
def open_page(chromium):
    """Open pages, each in a browser context of its own; the test fails if one logs an error or looks elsewhere."""
    contexts, problems = [], []

    def open_one(url: str, *, pad: bool = False, size: tuple[int, int] = (1366, 768)):
        context = chromium.new_context(viewport={"width": size[0], "height": size[1]})
        contexts.append(context)
        if pad:
            context.add_init_script(PAD)
        page = context.new_page()
        page.set_default_timeout(30_000)
        page.problems = problems
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: problems.append(request.url) if _is_foreign(request.url) else None)
        page.goto(url)
        until(page, "document.body.dataset.index > 0")
        return page

    def close_all() -> None:
        while contexts:
            contexts.pop().close()

    open_one.close_all = close_all
    yield open_one
    close_all()
    assert problems == []


def _is_foreign(url: str) -> bool:
    return not re.match(r"(https?|ws)://127\.0\.0\.1[:/]|(blob|data|about):", url)


@pytest.fixture(scope="session")
def live(quick_uri):
    """One server that plays a short scenario again and again, for tests that only watch."""
    with Live(quick_uri) as running:
        yield running
