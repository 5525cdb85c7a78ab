"""Make the pictures of all pages: `make screenshots`. Needs Chromium; look at them before you commit them.

python docs/screenshots.py [NAME ...]
"""

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import cv2

from haptigraph.assemble import build, load_procedure
from haptigraph.config import load_config

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from live_bench import PAD, Live, chromium, leave, until  # noqa: E402

from haptigraph.sim.phantom import Phantom  # noqa: E402
from haptigraph.sim.scenario import load_scenario  # noqa: E402

IMAGES = ROOT / "docs" / "images"
QUICK = f"phantom:{ROOT / 'tests' / 'data' / 'quick.toml'}"
ABSENT = f"phantom:{ROOT / 'tests' / 'data' / 'absent.toml'}"
FREEZING = (str(ROOT / "tests" / "dashboard" / "freezing.py"),)


def contact(page: Any, live: Live) -> None:
    """The alarm: pulses on the retina beside the target."""
    until(page, "document.body.dataset.state === 'retinal_contact'", 60)
    page.wait_for_timeout(700)


def hit(page: Any, live: Live) -> None:
    """The target, after an aligned approach, in a bright picture."""
    until(page, "document.body.dataset.state === 'target_hit'", 60)
    page.wait_for_timeout(700)


def lost(page: Any, live: Live) -> None:
    """Perception lost: no needle in the picture."""
    page.wait_for_selector("#banner:has-text('No needle seen')")


def stale(page: Any, live: Live) -> None:
    """The image is stale: the source delivers nothing more."""
    until(page, "document.body.dataset.state === 'misaligned_retinal_approach'", 60)
    live.process.send_signal(signal.SIGUSR1)
    page.wait_for_selector("#banner:has-text('No image')")
    page.wait_for_timeout(500)


def mapping(page: Any, live: Live) -> None:
    """The controller: what its sticks and buttons do, and how to change that."""
    page.evaluate(
        "window.pad.axes[1] = 0.7; window.pad.buttons[7].value = 1; window.pad.buttons[7].pressed = true"
    )
    page.click("#map")
    page.wait_for_timeout(300)


def registration(page: Any, live: Live) -> None:
    """The registration page, while somebody drags the target."""
    moment = Phantom(load_scenario("wrong_place_then_hit")).advance()
    eye = Path(gettempdir()) / "eye.png"
    cv2.imwrite(str(eye), moment.image if moment else None)
    page.goto(f"{live.url}registration")
    page.fill("#source", str(eye))
    page.click("text=Find the eye")
    page.wait_for_selector("#verdict:has-text('A run would take this')", timeout=120_000)
    eye.unlink()
    box = page.locator("[data-key=target] .area").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 30, y - 3, steps=5)
    page.wait_for_timeout(500)


def recordings(page: Any, live: Live) -> None:
    """One recorded run, and where a procedure with a wider cone differs; the page outlives its server."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        recorded = f'recording.path="{folder / "wrong_place.mcap"}"'
        given = ("source.uri=phantom:wrong_place_then_hit", recorded, "run.realtime=false")
        build(load_config(None, (*given, "trial.participant=P07", "trial.trial=3"))).run()
        text = load_procedure("subretinal_injection").text
        (folder / "wider_cone.toml").write_text(text.replace("= 1.7", "= 3.5"))
        with Live("phantom:wrong_place_then_hit", "--recordings", folder) as own:
            page.goto(f"{own.url}recordings#wrong_place.mcap")
            page.wait_for_selector("body[data-step='0']", timeout=60_000)
            page.select_option("#other", "wider_cone.toml")
            page.click("#compare")
            page.wait_for_selector("#verdict:not([hidden])", timeout=120_000)
            page.locator("#events button").last.click()
            page.wait_for_selector("#instead.differs")


SHOTS: dict[str, tuple[str, tuple[str, ...], tuple[int, int], Callable[[Any, Live], None]]] = {
    "live-contact": ("phantom:wrong_place_then_hit", (), (1366, 768), contact),
    "live-hit": ("phantom:align_then_approach", (), (1920, 1080), hit),
    "live-lost": (ABSENT, (), (1366, 768), lost),
    "live-stale": ("teleop:wrong_place_then_hit", FREEZING, (1366, 768), stale),
    "registration": (QUICK, (), (1366, 768), registration),
    "live-mapping": ("teleop:wrong_place_then_hit", (), (1366, 768), mapping),
    "recordings": ("phantom:wrong_place_then_hit", (), (1366, 768), recordings),
}
"""File name: what is served, by which program, how large, and what leads there."""


def main() -> None:
    """Make the pictures that were asked for, or all."""
    with chromium() as browser:
        for name in sys.argv[1:] or SHOTS:
            source, program, (width, height), lead = SHOTS[name]
            with Live(source, program=program or ("-m", "haptigraph")) as live:
                context = browser.new_context(viewport={"width": width, "height": height})
                context.add_init_script(PAD)
                page = context.new_page()
                page.problems = []
                page.goto(live.url)
                until(page, "document.body.dataset.index > 5")
                lead(page, live)
                page.screenshot(path=IMAGES / f"{name}.png")
                leave(page)
            print(IMAGES / f"{name}.png")


if __name__ == "__main__":
    main()
