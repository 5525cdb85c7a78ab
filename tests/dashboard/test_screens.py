"""Every page in every state fits every window, in both themes, and axe-core finds nothing wrong with it."""

import signal
import sys
from contextlib import ExitStack

import pytest
from helpers import mostly_slow
from inspecting import SIZES, axe_violations, layout_problems, use_theme
from live_bench import PAD, Live, until
from paths import DATA, ROOT
from registering import write_eye
from studying import PROTOCOL, Station, click_begin

from haptigraph.sources.phantom import PhantomSource

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(sys.platform == "win32", reason="signals"),
]

FREEZING = (str(ROOT / "tests" / "dashboard" / "freezing.py"),)
STEERED = f"teleop:{DATA / 'steered.toml'}"


NARROW_AND_USUAL = (SIZES[0], SIZES[3])
"""Every change is tested in these windows; `make test-slow` tests all."""


class Stage:
    """Leads a page into the states of this module; what it starts ends with it."""

    def __init__(self, context, archive, quick, folder, more):
        self.page, self.archive, self.quick, self.folder, self.more = (
            context.new_page(),
            archive,
            quick,
            folder,
            more,
        )

    def serve(self, *arguments, **options):
        return self.more.enter_context(Live(*arguments, **options))

    def open(self, url):
        self.page.goto(url)
        until(self.page, "document.body.dataset.index > 3", module="/static/live/live.js")

    def held(self, depth_mm, theta_deg, state):
        """Open a page on which the needle stays where it is; return its server."""
        scenario = self.folder / "held.toml"
        start = (DATA / "quick.toml").read_text().partition("[[move]]")[0]
        scenario.write_text(
            f"{start}[[move]]\nduration_s = 600\ndepth_mm = {depth_mm}\ntheta_deg = {theta_deg}\n"
        )
        live = self.serve(f"teleop:{scenario}", program=FREEZING)
        self.open(live.url)
        until(self.page, f"document.body.dataset.state === '{state}'", module="/static/live/live.js")
        return live

    def banner(self, words):
        self.page.wait_for_selector(f"#banner:has-text('{words}')")


def live_contact(stage):
    stage.held(23.4, -6.0, "retinal_contact")


def live_hit(stage):
    stage.held(22.8, 0.0, "target_hit")


def live_lost(stage):
    stage.open(stage.serve(f"phantom:{DATA / 'absent.toml'}").url)
    stage.banner("No instrument detected")


def live_tip_not_visible(stage):
    stage.held(12.0, -6.0, "misaligned_intraocular_navigation").process.send_signal(signal.SIGUSR2)
    stage.banner("Tip not visible")


def live_stale(stage):
    stage.held(12.0, -6.0, "misaligned_intraocular_navigation").process.send_signal(signal.SIGUSR1)
    stage.banner("No image")


def live_disconnected(stage):
    stage.held(12.0, -6.0, "misaligned_intraocular_navigation").process.kill()
    stage.banner("Connection lost")


def live_steered(stage):
    stage.open(stage.serve(STEERED).url)
    stage.page.wait_for_selector("#health li")


def live_mapping(stage):
    live_steered(stage)
    stage.page.click("#map")


def live_assumed(stage):
    source = DATA / "quick.toml"
    text = PhantomSource(str(source)).registration.replace(
        "format = 1\n", 'format = 1\nassumed = ["target"]\n'
    )
    registration = stage.folder / "assumed.toml"
    registration.write_text(text)
    stage.open(stage.serve(f"phantom:{source}", "--registration", registration).url)
    stage.page.wait_for_selector("#assumed:has-text('assumed, not measured')")


def recordings_list(stage):
    stage.page.goto(f"{stage.archive.url}recordings")
    stage.page.wait_for_selector("#runs tr:has-text('hit after')")


def recordings_run(stage):
    stage.page.goto(f"{stage.archive.url}recordings#quick.mcap")
    stage.page.wait_for_selector("body[data-step='0']")
    stage.page.select_option("#other", "wide.toml")
    stage.page.click("#compare")
    stage.page.wait_for_selector("#verdict:not([hidden])", timeout=60_000)


def registration_empty(stage):
    stage.page.goto(f"{stage.archive.url}registration")


def registration_draft(stage):
    registration_empty(stage)
    stage.page.fill("#source-input", str(write_eye(stage.folder, stage.quick)))
    stage.page.click("text=Find the eye")
    stage.page.wait_for_selector("#verdict:has-text('Valid registration')", timeout=90_000)


def registration_exists(stage):
    registration_draft(stage)
    (stage.folder / "made.toml").write_text("precious")
    stage.page.fill("#path", str(stage.folder / "made.toml"))
    stage.page.click("#save-button")
    stage.page.wait_for_selector("#exists[open]")


def study_idle(stage):
    (stage.folder / "study.toml").write_text(PROTOCOL)
    station = stage.more.enter_context(Station(stage.folder, STEERED))
    stage.page.goto(station.url)
    stage.page.wait_for_selector("#stage:has-text('No participant')")
    return station


def study_enrolled(stage):
    """With the participant's own page beside it."""
    station = study_idle(stage)
    stage.page.click("#enrol button")
    stage.page.wait_for_selector("#participant:has-text('P01')")
    person = stage.page.context.new_page()
    person.goto(f"{station.url}participant")
    person.wait_for_selector("#text-done")
    return person


def study_dialog(stage):
    study_enrolled(stage)
    stage.page.click("#stop")


def study_training(stage):
    """In a trial, with notes."""
    person = study_participant_questionnaire(stage, shows_it=False)
    for field in person.locator(".item:has(input[type=radio])").all():
        field.locator("label").last.click()
    for field in person.locator(".item input:not([type=radio])").all():
        field.fill("33")
        field.blur()
    person.click("text=Submit")
    person.wait_for_selector("#begin:visible")
    stage.page.fill("#note-text", "asked whether the cross moves")
    stage.page.keyboard.press("Enter")
    click_begin(person)
    stage.page.wait_for_selector("body[data-trial=running][data-index]")
    return person


def study_participant_text(stage):
    stage.page = study_enrolled(stage)


def study_participant_questionnaire(stage, *, shows_it=True):
    person = study_enrolled(stage)
    person.click("#text-done")
    person.click("text=I agree")
    person.wait_for_selector(".item")
    stage.page = person if shows_it else stage.page
    return person


def study_participant_trial(stage):
    stage.page = study_training(stage)


SCENES = (
    live_steered,
    live_mapping,
    live_contact,
    live_hit,
    live_lost,
    live_tip_not_visible,
    live_stale,
    live_disconnected,
    live_assumed,
    recordings_list,
    recordings_run,
    registration_empty,
    registration_draft,
    registration_exists,
    study_idle,
    study_dialog,
    study_training,
    study_participant_text,
    study_participant_questionnaire,
    study_participant_trial,
)


USUAL = (
    live_contact,
    recordings_run,
    registration_draft,
    study_training,
)
"""Every change is tested in these states; `make test-slow` tests all."""


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(scene, id=scene.__name__, marks=() if scene in USUAL else pytest.mark.slow)
        for scene in SCENES
    ],
)
def page(request, chromium, archive, quick, tmp_path_factory):
    with ExitStack() as more:
        window = {"width": 1280, "height": 720}
        context = chromium.new_context(viewport=window, reduced_motion="reduce", has_touch=True)
        more.callback(context.close)
        context.add_init_script(PAD)
        context.set_default_timeout(30_000)
        stage = Stage(context, archive, quick, tmp_path_factory.mktemp("stage"), more)
        request.param(stage)
        stage.page.bring_to_front()
        yield stage.page


@pytest.mark.parametrize(
    "size",
    [
        pytest.param(size, id=f"{size[0]}px", marks=() if size in NARROW_AND_USUAL else pytest.mark.slow)
        for size in SIZES
    ],
)
def test_nothing_overlaps_is_cut_off_or_scrolls_sideways(page, size):
    for theme in ("light", "dark"):
        use_theme(page, theme)
        assert layout_problems(page, size) == [], theme


@pytest.mark.parametrize("theme", mostly_slow(["dark", "light"], "dark"))
def test_axe_finds_no_violations(page, theme):
    page.set_viewport_size({"width": 1280, "height": 720})
    use_theme(page, theme)
    assert axe_violations(page, only_colors=theme == "light") == []
