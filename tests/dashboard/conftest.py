"""The real server in a process of its own, and Debian's Chromium to look at it. Skipped where it is absent."""

import re
import shutil
import signal
import subprocess
import sys

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


class Live:
    """A running `haptigraph live`.

    Args:
        arguments: What stands behind `haptigraph live`.
    """

    def __init__(self, *arguments: object) -> None:
        command = [sys.executable, "-m", "haptigraph", "live", *map(str, arguments)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.told: list[str] = []
        for line in self.process.stderr:
            self.told.append(line)
            if found := re.search(r"the page is at (http://\S+)", line):
                self.url = found[1]
                return
        raise AssertionError("".join(self.told))

    def stop(self, how: signal.Signals = signal.SIGINT) -> str:
        """End it and return all it said."""
        self.process.send_signal(how)
        out, err = self.process.communicate(timeout=30)
        return "".join(self.told) + out + err

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, headless=True)
        yield browser
        browser.close()


@pytest.fixture
def page(chromium):
    """A fresh page; the test fails if it logged an error or asked for anything from elsewhere."""
    context = chromium.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    page.set_default_timeout(20_000)
    problems: list[str] = []
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: problems.append(request.url) if _is_foreign(request.url) else None)
    page.problems = problems
    yield page
    context.close()
    assert problems == []


def _is_foreign(url: str) -> bool:
    return not re.match(r"(https?|ws)://127\.0\.0\.1[:/]|(blob|data|about):", url)


@pytest.fixture(scope="session")
def live(quick_uri):
    """One server that plays a short scenario again and again, for tests that only watch."""
    with Live(quick_uri) as running:
        yield running
