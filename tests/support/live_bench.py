"""The real server in a process of its own, and Debian's Chromium: for tests, benchmarks and screenshots."""

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
UNUSED_FEATURES = [
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup"),  # each loads a page of its own with every window
    # Chromium heeds only the last list, so those that Playwright disables again.
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades"),
    *("HttpsFirstBalancedModeAutoEnable", "LensOverlay", "MediaRouter", "PaintHolding", "OptimizationHints"),
    *("ThirdPartyStoragePartitioning", "NetworkTimeServiceQuerying", "AimEnabled", "PreconnectToSearch"),
]
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--disable-features={','.join(UNUSED_FEATURES)}",
]
PAD = """
window.rumble = [];  // every call, with its time [ms since 1970]
window.pad = {
  id: "Test controller (STANDARD)", index: 0, connected: true, mapping: "standard",
  axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ value: 0, pressed: false })),
  vibrationActuator: {
    type: "dual-rumble", effects: ["dual-rumble"],
    end(result) { this.resolve?.(result); this.resolve = null; },
    playEffect(type, effect) {
      window.rumble.push({ at: performance.timeOrigin + performance.now(), type, ...effect });
      this.end("preempted");
      return new Promise((resolve) => { this.resolve = resolve; setTimeout(() => resolve("complete"), effect.duration); });
    },
    reset() { window.rumble.push({ at: performance.timeOrigin + performance.now(), type: "reset", duration: 0 }); this.end("preempted"); return Promise.resolve("complete"); },
  },
};
navigator.getGamepads = () => [window.pad, null, null, null];
"""
"""Script that simulates a game controller and logs its rumble; an effect ends as the Gamepad standard says."""


PHONE = """
window.buzz = [];  // every call, with its time [ms since 1970]
Navigator.prototype.vibrate = (pattern) => { window.buzz.push({ at: performance.timeOrigin + performance.now(), pattern: [pattern].flat() }); return true; };
"""
"""Script that logs what a phone's own motor is asked for."""


class Live:
    """A running `haptigraph live`; a context manager that kills it.

    Args:
        arguments: Of `haptigraph live`.
        program: Python arguments that replace `-m haptigraph`.
        command: Command that serves pages.
    """

    def __init__(
        self,
        *arguments: object,
        program: tuple[str, ...] = ("-m", "haptigraph"),
        command: tuple[str, ...] = ("live",),
    ) -> None:
        command_line = [sys.executable, *program, *command, *map(str, arguments)]
        self.process = subprocess.Popen(
            command_line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.lines: list[str] = []
        self.url = ""
        for line in self.process.stderr or ():
            self.lines.append(line)
            if found := re.search(r"the page is at (http://\S+)", line):
                self.url = found[1]
                return
        raise AssertionError("".join(self.lines))

    def stop(self, how: signal.Signals = signal.SIGTERM) -> str:
        """Stop it and return all its output. (Background processes of a shell ignore SIGINT.)"""
        self.process.send_signal(how)
        out, err = self.process.communicate(timeout=30)
        return "".join(self.lines) + out + err

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@contextmanager
def chromium() -> Iterator[Any]:
    """Start headless Chromium with a profile of its own."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, headless=True)
        yield browser
        browser.close()


LIVE = "/static/live/live.js"
"""The module whose `page` expressions refer to."""


def evaluate(page: Any, expression: str, module: str = "") -> Any:
    """Return the value of a JavaScript expression in which `page` is the page's state."""
    module = module or getattr(page, "module", LIVE)
    return page.evaluate(
        f"async () => {{ const {{ page }} = await import('{module}'); return {expression}; }}"
    )


def until(page: Any, condition: str, within_s: float = 30, module: str = "") -> Any:
    """Wait until a JavaScript expression in which `page` is the page's state is true; return its value.

    Unlike Playwright's `wait_for_function` it needs no eval, which the page's policy forbids.
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


def close_page(page: Any) -> None:
    """Close a page whose server stops, and drop the errors that the browser logs about it, even later."""
    page.is_left = True
    page.close()
    expected = ("WebSocket connection to", "Failed to load resource: net::ERR_")
    page.problems[:] = [problem for problem in page.problems if not any(word in problem for word in expected)]


def hide(page):
    page.evaluate(
        "() => { Object.defineProperty(document, 'hidden', { configurable: true, get: () => true }); document.dispatchEvent(new Event('visibilitychange')); }"
    )


def show(page):
    page.evaluate("() => { delete document.hidden; document.dispatchEvent(new Event('visibilitychange')); }")
