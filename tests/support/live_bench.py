"""The real server in a process of its own, and Debian's Chromium to look at it: for tests, figures and pictures."""

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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
PAD = """
window.rumble = [];  // every call, with the moment it was made [ms since 1970]
window.pad = {
  id: "Test controller (STANDARD)", index: 0, connected: true, mapping: "standard",
  axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ value: 0, pressed: false })),
  vibrationActuator: {
    type: "dual-rumble", effects: ["dual-rumble"],
    playEffect(type, effect) { window.rumble.push({ at: performance.timeOrigin + performance.now(), type, ...effect }); return Promise.resolve("complete"); },
    reset() { window.rumble.push({ at: performance.timeOrigin + performance.now(), type: "reset", duration: 0 }); return Promise.resolve("complete"); },
  },
};
navigator.getGamepads = () => [window.pad, null, null, null];
"""
"""A game controller put into the browser, whose rumble is written down."""


class Live:
    """A running `haptigraph live`; a context manager that ends it.

    Args:
        arguments: What stands behind `haptigraph live`.
        program: What is run instead of `python -m haptigraph`.
        command: Another command that serves pages.
    """

    def __init__(
        self,
        *arguments: object,
        program: tuple[str, ...] = ("-m", "haptigraph"),
        command: tuple[str, ...] = ("live",),
    ) -> None:
        whole = [sys.executable, *program, *command, *map(str, arguments)]
        self.process = subprocess.Popen(whole, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.told: list[str] = []
        self.url = ""
        for line in self.process.stderr or ():
            self.told.append(line)
            if found := re.search(r"the page is at (http://\S+)", line):
                self.url = found[1]
                return
        raise AssertionError("".join(self.told))

    def stop(self, how: signal.Signals = signal.SIGTERM) -> str:
        """End it and return all it said. (What a shell runs in its background ignores SIGINT.)"""
        self.process.send_signal(how)
        out, err = self.process.communicate(timeout=30)
        return "".join(self.told) + out + err

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@contextmanager
def chromium() -> Iterator[Any]:
    """Start Chromium without a window, with a profile of its own."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, headless=True)
        yield browser
        browser.close()


LIVE = "/static/live/live.js"
"""The module whose `page` is looked at."""


def look(page: Any, expression: str, module: str = "") -> Any:
    """Return the value of a JavaScript expression, in which `page` is what the page knows."""
    module = module or getattr(page, "module", LIVE)
    return page.evaluate(
        f"async () => {{ const {{ page }} = await import('{module}'); return {expression}; }}"
    )


def until(page: Any, condition: str, within_s: float = 30, module: str = "") -> Any:
    """Wait until a JavaScript expression, in which `page` is what the page knows, is true; return its value.

    Unlike Playwright's own `wait_for_function` it needs no eval, which the page's policy forbids.
    """
    return page.evaluate(
        """(within_ms) => new Promise(async (resolve, reject) => {
             const { page } = await import("MODULE");
             const end_ms = performance.now() + within_ms;
             const check = async () => {
               try {
                 const value = await (async () => CONDITION)();
                 if (value) resolve(value);
                 else if (performance.now() > end_ms) reject(new Error("not in time"));
                 else setTimeout(check, 10);
               } catch (error) { reject(error); }
             };
             check();
           })""".replace("CONDITION", f"({condition})").replace(
            "MODULE", module or getattr(page, "module", LIVE)
        ),
        within_s * 1000,
    )


def leave(page: Any) -> None:
    """Close a page whose server goes away: the browser logs that it has, and that is right."""
    page.close()
    gone = ("WebSocket connection to", "Failed to load resource: net::ERR_")
    page.problems[:] = [problem for problem in page.problems if not any(word in problem for word in gone)]


def hide(page):
    page.evaluate(
        "() => { Object.defineProperty(document, 'hidden', { configurable: true, get: () => true }); document.dispatchEvent(new Event('visibilitychange')); }"
    )


def show(page):
    page.evaluate("() => { delete document.hidden; document.dispatchEvent(new Event('visibilitychange')); }")
