"""Take the screenshots of all pages: `make screenshots`. Needs Chromium; look at them before you commit them.

python docs/screenshots.py [NAME ...]
"""

import os
import shutil
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any, NamedTuple

import cv2

from haptigraph.assemble import build, load_procedure
from haptigraph.config import load_config

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "study")]
from live_bench import PAD, PHONE, Live, chromium, close_page, evaluate, until  # noqa: E402
from walking import do_next, go_to  # noqa: E402

from haptigraph.sim.phantom import Phantom  # noqa: E402
from haptigraph.sim.scenario import load_scenario  # noqa: E402
from haptigraph.study.protocol import load_protocol  # noqa: E402
from haptigraph.study.roster import Study  # noqa: E402
from haptigraph.study.runner import open_session  # noqa: E402
from haptigraph.study.store import Store  # noqa: E402

IMAGES = ROOT / "docs" / "images"
QUICK = "phantom:tests/data/quick.toml"
ABSENT = "phantom:tests/data/absent.toml"
SHOWN = "/data"  # instead of a temporary folder
TIMEOUT_S = 240  # for busy machines
PATIENT = ("--set", "haptics.deadman_ms=1000")  # so that no page calls a busy machine's connection slow
FREEZING = (str(ROOT / "tests" / "dashboard" / "freezing.py"),)


def in_state(state: str, wait_ms: int = 700) -> Callable[[Any, Live], None]:
    """Return a function that waits for a state, and a little longer."""

    def wait(page: Any, live: Live) -> None:
        until(page, f"document.body.dataset.state === '{state}'", TIMEOUT_S)
        page.wait_for_timeout(wait_ms)

    return wait


def lost(page: Any, live: Live) -> None:
    """No needle in the picture."""
    page.wait_for_selector("#banner:has-text('No instrument detected')")


def stale(page: Any, live: Live) -> None:
    """A stale image: the source delivers nothing any more."""
    until(page, "document.body.dataset.state === 'misaligned_retinal_approach'", TIMEOUT_S)
    live.process.send_signal(signal.SIGUSR1)
    page.wait_for_selector("#banner:has-text('No image')")
    page.wait_for_timeout(500)


def tip_not_visible(page: Any, live: Live) -> None:
    """A needle whose shaft is seen, but not its tip."""
    until(page, "document.body.dataset.state === 'misaligned_retinal_approach'", TIMEOUT_S)
    live.process.send_signal(signal.SIGUSR2)
    page.wait_for_selector("#banner:has-text('Tip not visible')")
    page.wait_for_timeout(700)


def first_visit(page: Any, live: Live) -> None:
    """The live page as a new user sees it."""
    page.wait_for_selector("#hint")
    page.wait_for_selector("#health li.plain")
    page.wait_for_selector("#banner", state="hidden")


def mapping(page: Any, live: Live) -> None:
    """The mapping of a controller's sticks and buttons."""
    page.evaluate(
        "window.pad.axes[1] = 0.7; window.pad.buttons[7].value = 1; window.pad.buttons[7].pressed = true"
    )
    page.click("#map")
    page.wait_for_timeout(300)


def registration(page: Any, live: Live) -> None:
    """The registration page, while the target is dragged."""
    moment = Phantom(load_scenario("wrong_place_then_hit")).advance()
    eye = Path(gettempdir()) / "eye.png"
    cv2.imwrite(str(eye), moment.image if moment else None)
    page.goto(f"{live.url}registration")
    page.fill("#source-input", str(eye))
    page.click("text=Find the eye")
    page.wait_for_selector("#verdict:has-text('Valid registration')", timeout=TIMEOUT_S * 1000)
    eye.unlink()
    box = page.locator("[data-key=target] .area").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 30, y - 3, steps=5)
    for name in ("source-input", "path"):
        path = page.input_value(f"#{name}").replace(gettempdir(), SHOWN)
        page.evaluate("([name, path]) => { document.getElementById(name).value = path; }", [name, path])
    page.wait_for_timeout(500)


def recordings_list(page: Any, live: Live) -> None:
    """The list of recordings of a folder."""
    folder = Path(page.more.enter_context(TemporaryDirectory())) / "recordings"
    shutil.copytree(ROOT / "tests" / "replay" / "golden", folder)
    own = page.more.enter_context(Live(QUICK, "--recordings", folder))
    page.goto(f"{own.url}recordings")
    page.wait_for_selector("#runs tr")
    page.wait_for_selector("#runs td:text-is('…')", state="detached", timeout=TIMEOUT_S * 1000)
    page.evaluate(
        "(name) => { document.querySelector('#folder').textContent = name; }", f"{SHOWN}/recordings"
    )


def recordings(page: Any, live: Live) -> None:
    """One recorded run, compared with a procedure with a wider cone; the page outlives its server."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        recorded = f'recording.path="{folder / "wrong_place.mcap"}"'
        given = ("source.uri=phantom:wrong_place_then_hit", recorded, "run.realtime=false")
        build(load_config(None, (*given, "trial.participant=P07", "trial.trial=3"))).run()
        text = load_procedure("subretinal_injection").text
        (folder / "wider_cone.toml").write_text(text.replace("= 1.7", "= 3.5"))
        with Live("phantom:wrong_place_then_hit", "--recordings", folder) as own:
            page.goto(f"{own.url}recordings#wrong_place.mcap")
            page.wait_for_selector("body[data-step='0']", timeout=TIMEOUT_S * 1000)
            page.select_option("#other", "wider_cone.toml")
            page.click("#compare")
            page.wait_for_selector("#verdict:not([hidden])", timeout=TIMEOUT_S * 1000)
            page.locator("#events button").last.click()
            page.wait_for_selector("#instead.differs")


def study_folder(page: Any) -> Path:
    """Create a study: one participant has finished, one is at another station, one is about to begin."""
    folder = Path(page.more.enter_context(TemporaryDirectory()))
    text = files("haptigraph.study").joinpath("templates").joinpath("study.toml").read_text()
    (folder / "study.toml").write_text(text)
    with closing(Store(folder / "study.db")) as store:
        study = Study(load_protocol(folder), store)
        for station, until_kind in (("lab 1", "thanks"), ("lab 2", "break"), ("lab 1", "trial")):
            session = open_session(study, study.enrol(), station)
            go_to(session, until_kind)
            if until_kind == "thanks":
                do_next(session)
                session.close()
        session.note("left-handed, holds the controller in the left")
    return folder


def study_pages(page: Any) -> tuple[Any, Any, str]:
    """Open a study whose participant is about to begin a trial; return both pages and the address."""
    given = (
        "--source",
        "teleop:wrong_place_then_hit",
        "--station",
        "lab 1",
        "--set",
        "run.stale_ms=2000",
        *PATIENT,
    )
    own = page.more.enter_context(Live(study_folder(page), *given, command=("study", "run")))
    page.module = "/static/study/study.js"
    page.goto(own.url)
    page.click("#roster button:has-text('Resume')")
    person = page.context.new_page()
    person.module = "/static/study/participant.js"
    person.goto(f"{own.url}participant")
    person.wait_for_selector("#begin")
    return page, person, own.url


def steer_aside(person: Any) -> None:
    """Insert the needle beside the target, until it approaches the retina."""
    if not evaluate(person, "page.status.touch.output"):  # on a phone, without a controller
        person.click("#setup summary")
        person.click("#outputs label:has-text('phone')")
        person.click("#setup summary")
    for button in ("#pulse", "#felt", "#begin"):
        person.click(button)
    until(person, "page.status.trial_status === 'running' && page.header?.index > 3", TIMEOUT_S)
    person.keyboard.down("ArrowDown")
    until(person, "page.header.state === 'misaligned_retinal_approach'", TIMEOUT_S)


def study_experimenter(page: Any, live: Live) -> None:
    """The experimenter's page, during a misaligned approach of the participant."""
    page, person, _ = study_pages(page)
    page.fill("#note-text", "asked whether the cross moves")
    page.keyboard.press("Enter")
    steer_aside(person)
    page.bring_to_front()
    until(page, "document.body.dataset.state === 'misaligned_retinal_approach'", TIMEOUT_S)


def study_participant(page: Any, live: Live) -> None:
    """The participant's page during the same approach."""
    _, person, url = study_pages(page)
    person.close()
    page.module = "/static/study/participant.js"
    page.goto(f"{url}participant")
    page.wait_for_selector("#begin")
    steer_aside(page)


def study_questionnaire(page: Any, live: Live) -> None:
    """A questionnaire, partly answered."""
    page, person, url = study_pages(page)
    person.close()
    page.click("#enrol button")
    page.click("#confirm")
    page.wait_for_selector("#participant:has-text('P04')")
    page.goto(f"{url}participant")
    page.click("#text-done")
    page.click("text=I agree")
    page.fill("[data-item=age_years] input", "31")
    page.click("[data-item=gender] label:has-text('female')")
    page.click("[data-item=handedness] label:has-text('left')")
    page.wait_for_selector("[data-item=handedness].is-saved")


class Screenshot(NamedTuple):
    """One state of a page."""

    source: str
    """Arguments of `haptigraph live`."""
    prepare: Callable[[Any, Live], None]
    """Leads to the state."""
    size: tuple[int, int] = (1366, 768)
    theme: str = "dark"
    program: tuple[str, ...] = ("-m", "haptigraph")


POCKET = (390, 844)
WRONG_PLACE, STEERED = "phantom:wrong_place_then_hit", "teleop:wrong_place_then_hit"
SLOW = "--set run.stale_ms=2000"

SCREENSHOTS = {
    "live-contact": Screenshot(WRONG_PLACE, in_state("retinal_contact")),
    "live-contact-light": Screenshot(WRONG_PLACE, in_state("retinal_contact"), theme="light"),
    "live-volume": Screenshot(
        "phantom:volume_approach --procedure subretinal_injection_4d",
        in_state("ilm_contact", 0),
        (1440, 1000),
    ),
    "live-hit": Screenshot("phantom:align_then_approach", in_state("target_hit"), (1920, 1080)),
    "live-peeling": Screenshot(
        f"phantom:membrane_peeling --procedure membrane_peeling {SLOW}", in_state("peeling", 2500)
    ),
    "live-oct": Screenshot(
        f"phantom:ioct_approach --procedure subretinal_injection_ioct {SLOW}", in_state("target_depth")
    ),
    "live-phases": Screenshot(
        f"phantom:injection_with_phases --procedure subretinal_injection_phases {SLOW}",
        in_state("injecting", 2500),
    ),
    "live-lost": Screenshot(ABSENT, lost),
    "live-stale": Screenshot(STEERED, stale, program=FREEZING),
    "live-tip-not-visible": Screenshot(STEERED, tip_not_visible, program=FREEZING),
    "live-mapping": Screenshot(STEERED, mapping),
    "live-phone": Screenshot(STEERED, first_visit, POCKET),
    "live-phone-light": Screenshot(STEERED, first_visit, POCKET, "light"),
    "registration": Screenshot(QUICK, registration),
    "registration-phone": Screenshot(QUICK, registration, POCKET, "light"),
    "recordings": Screenshot(WRONG_PLACE, recordings),
    "recordings-light": Screenshot(WRONG_PLACE, recordings, theme="light"),
    "recordings-phone": Screenshot(WRONG_PLACE, recordings, POCKET),
    "recordings-list": Screenshot(QUICK, recordings_list),
    "recordings-list-phone": Screenshot(QUICK, recordings_list, POCKET, "light"),
    "study-experimenter": Screenshot(QUICK, study_experimenter),
    "study-experimenter-phone": Screenshot(QUICK, study_experimenter, POCKET, "light"),
    "study-participant": Screenshot(QUICK, study_participant),
    "study-participant-phone": Screenshot(QUICK, study_participant, POCKET),
    "study-questionnaire": Screenshot(QUICK, study_questionnaire, theme="light"),
    "study-questionnaire-phone": Screenshot(QUICK, study_questionnaire, POCKET, "light"),
}
"""By file name."""


def main() -> None:
    """Take the screenshots that the command line names, or all."""
    os.chdir(ROOT)  # so that no screenshot shows this folder
    with chromium() as browser:
        for name in sys.argv[1:] or SCREENSHOTS:
            take(name, browser)
            print(IMAGES / f"{name}.png")


def take(name: str, browser: Any) -> None:
    """Take one screenshot."""
    source, prepare, (width, height), theme, program = SCREENSHOTS[name]
    is_phone = (width, height) == POCKET
    with Live(*source.split(), *PATIENT, program=program) as live, ExitStack() as more:
        viewport = {"width": width, "height": height}
        context = browser.new_context(viewport=viewport, color_scheme=theme, has_touch=is_phone)
        context.add_init_script(PHONE if is_phone else PAD)
        for hint in ("steer", "watch", "registration") if prepare is not first_visit else ():
            context.add_init_script(f"localStorage.setItem('hint-{hint}', 'closed')")
        page = context.new_page()
        page.problems, page.more = [], more  # other servers run until the screenshot is taken
        page.goto(live.url)
        until(page, "document.body.dataset.index > 5")
        prepare(page, live)
        page.evaluate("scrollTo(0, 0)")
        page.screenshot(path=IMAGES / f"{name}.png")
        close_page(page)


if __name__ == "__main__":
    main()
