"""Helpers of the tests of the study pages: a short protocol, a station that serves it, rows of its store."""

import json
import math
import signal
from contextlib import closing, contextmanager

from live_bench import Live, close_page, evaluate, until
from paths import DATA
from playwright.sync_api import Error
from registering import send_to
from sqlalchemy import select
from visiting import watching

from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.store import Store

__all__ = [
    "PARTICIPANT",
    "STUDY",
    "Station",
    "align",
    "aligned_source",
    "answer_all",
    "begin",
    "click_begin",
    "close_study",
    "experimenter_at",
    "feel_pulse",
    "kill",
    "page_with_outputs",
    "participant_at",
    "push_to_the_target",
    "rows_of",
    "send_to",
    "study_at",
    "wait_for_stage",
]

STUDY, PARTICIPANT = "/static/study/study.js", "/static/study/participant.js"
PROTOCOL = """
[study]
name = "short"
title = "A short study"
design = "within"
participants = 3
seed = 1
order = "fixed"

[texts]
briefing = "Steer the needle.\\n\\nHit the target."
consent = "I take part of my own free will."
break_text = "Rest your hand."

[trials]
timeout_s = 300
attempts = 2

[training]
before = "study"
condition = "felt"
timeout_s = 300

[[condition]]
name = "felt"
title = "Detection and touch"

[[condition]]
name = "seen"
title = "Detection alone"
touch = false
display = "overlays"

[[target]]
name = "left"
along_mm = -2

[[target]]
name = "right"
along_mm = 3

[[questionnaire]]
file = "demographics"
when = "start"

[[questionnaire]]
file = "sus"
when = "condition"
"""


class Station(Live):
    """A running `haptigraph study run`."""

    def __init__(self, folder, source, *more, station="lab 1"):
        given = (folder, "--source", source, "--station", station, *more)
        super().__init__(*given, command=("study", "run"))

    @property
    def port(self):
        return self.url.rpartition(":")[2].strip("/")


@contextmanager
def page_with_outputs(station, *names):
    """Connect as a participant's page on which these outputs work."""
    with watching(station, path="/participant/live", max_queue=None) as line:
        line.send(json.dumps({"type": "outputs", "names": names}))
        yield line


def feel_pulse(station, trial):
    """Test the haptic feedback as the participant's page does, and feel it; return the status."""
    while not (status := send_to(station, "/participant/status")[1])["touch"]["output"]:
        assert station.process.poll() is None
    if status["touch"]["problem"]:
        assert send_to(station, "/participant/pulse", trial)[0] == 200
        status = send_to(station, "/participant/felt", {**trial, "is_felt": True})[1]
    assert status["touch"]["problem"] == ""
    return status


def click_begin(page):
    """Begin a trial on a participant's page; test the haptic feedback before, if it was not yet felt."""
    page.wait_for_selector("#begin:enabled, #pulse:visible")
    if page.is_visible("#pulse"):
        assert page.is_disabled("#begin")
        feel_on_page(page)
    page.click("#begin")


def feel_on_page(page):
    """Feel the test pulse; test again if a page without processor time played none, for it plays nothing late."""
    for _ in range(3):
        page.evaluate("() => { window.rumble.length = 0; }")
        page.click("#pulse")
        page.wait_for_selector("#felt:visible")
        if played := page.evaluate("() => window.rumble.filter(({ type }) => type === 'dual-rumble')"):
            assert played[0]["strongMagnitude"] == 1
            page.click("#felt")
            return
        page.click("#unfelt")
        page.wait_for_selector("#pulse:visible")
    raise AssertionError("no test pulse was played")


def study_at(folder, store):
    return Study(load_protocol(folder), store)


def rows_of(folder, table, *columns):
    """Return the rows of a table as tuples of columns, read from the store's file."""
    with closing(Store(folder / "study.db")) as store:
        rows = store.rows(select(table).order_by(*(table.c[name] for name in columns)))
        return [tuple(row[name] for name in columns) for row in rows]


def answer_all(page):
    """Answer all open items, with the last choice each."""
    open_items = "[...document.querySelectorAll('.item:not(.is-saved)')].map((each) => each.dataset.item)"
    for item in page.evaluate(open_items):
        field = page.locator(f".item[data-item='{item}']")
        if field.locator("input[type=radio]").count():
            field.locator("label").last.click()
        else:
            field.locator("input").fill("33")
            field.locator("input").blur()


def aligned_source(folder):
    """Write a scenario with small images, in which the needle is inside and points at the target."""
    text = (DATA / "steered.toml").read_text()
    path = folder / "aligned.toml"
    path.write_text(
        text.replace("theta_deg = -6.0", "theta_deg = 0.0").replace("depth_mm = 8.0", "depth_mm = 14.0")
    )
    return f"teleop:{path}"


def experimenter_at(station, open_page):
    return open_page(station.url, module=STUDY, ready="page.status")


def participant_at(station, open_page, *, pad=True):
    return open_page(
        f"{station.url}participant", module=PARTICIPANT, ready="page.status && page.isOpen", pad=pad
    )


def wait_for_stage(page, key):
    until(page, f"document.body.dataset.stage === '{key}'")


def begin(page):
    page.evaluate("() => { window.rumble.length = 0; }")
    click_begin(page)
    until(page, "page.status.trial_status === 'running' && page.header?.index > 3")


def align(page):
    """Tap the arrow keys until the needle points at the target; a busy machine may take a tap as long."""
    keys, before_deg = ["ArrowRight", "ArrowLeft"], math.inf
    for _ in range(100):
        theta_deg = evaluate(page, "page.header.measures.theta_deg")
        if theta_deg < 0.8:
            return
        if theta_deg > before_deg:
            keys.reverse()
        before_deg = theta_deg
        page.keyboard.press(keys[0], delay=50)
        seen = evaluate(page, "page.header.number")
        until(page, f"page.header.number > {seen + 5} && 'theta_deg' in page.header.measures")
    raise AssertionError(evaluate(page, "page.header"))


def push_to_the_target(page):
    """Push the needle until it hits; again if it stopped because the page lost data on a busy machine."""
    for patience_s in (10, 20, 30):
        page.keyboard.down("ArrowDown")
        try:
            return until(page, "page.header.state === 'target_hit'", patience_s)
        except Error:
            header = evaluate(page, "page.header")
        finally:
            page.keyboard.up("ArrowDown")
    raise AssertionError(header)


def close_study(lab, person, station, open_page):
    """Wait until the experimenter's page says that all is done, and end pages and program."""
    lab.wait_for_selector("#stage:has-text('all is done')")
    close_page(lab)
    close_page(person)
    open_page.close_all()
    station.stop()


def kill(station):
    station.process.send_signal(signal.SIGKILL)
    station.process.wait()
