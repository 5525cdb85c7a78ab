"""The live page in a real browser, with the real server."""

import re
import signal

import pytest
from helpers import call
from live_bench import Live, close_page, evaluate, hide, show, until
from paths import ROOT

from haptigraph.recording.reader import RunReader

pytestmark = pytest.mark.browser


def test_the_page_follows_the_loop(live, open_page):
    page = open_page(live.url)
    until(page, "document.body.dataset.index > 20")
    assert page.inner_text("nav a[aria-current=page]") == "Live"
    assert "not a medical device" in page.inner_text("body")
    until(page, "document.querySelector('#health').textContent.includes('images/s')")
    assert page.inner_text("#source").startswith("phantom:")


def test_a_force_is_shown_as_commanded_because_no_device_may_exert_it(live, open_page):
    page = open_page(live.url)
    felt = "(pattern, forces) => import('/static/common/state_panel.js').then((it) => it.feltText(pattern, forces))"

    def text(pattern, *forces):
        return page.evaluate(f"([pattern, forces]) => ({felt})(pattern, forces)", [pattern, list(forces)])

    off, low = {"kind": "off"}, {"kind": "continuous", "amplitude": 0.3}
    assert text(off) == "nothing"
    assert text(off, "drag") == "no vibration; force commanded: drag"
    assert text(low, "guide", "floor") == "steady vibration, 30 %; force commanded: guide, floor"


@pytest.mark.parametrize(
    "size",
    [
        pytest.param((1366, 768), marks=pytest.mark.slow),
        (1366, 660),
        pytest.param((1920, 1080), marks=pytest.mark.slow),
    ],
)
def test_everything_is_on_one_screen(live, open_page, size):
    page = open_page(live.url, size=size)
    extent = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    assert page.evaluate(extent) == list(size)
    page.wait_for_selector("#health li")
    worse = f"(document.querySelector('#health').append(' of a slow machine'.repeat(20)), {extent})"
    assert page.evaluate(worse) == list(size)
    hidden = page.evaluate(
        """[...document.querySelectorAll('.panel, #state, #because, footer, #overlays, #feels')].filter((each) => {
             if (each.hidden) return false;
             const box = each.getBoundingClientRect();
             return box.width === 0 || box.bottom > innerHeight + 1 || box.right > innerWidth + 1 || each.scrollWidth > each.clientWidth + 1;
           }).map((each) => each.id || each.className)"""
    )
    assert hidden == []


def test_an_assumed_target_is_marked_and_nothing_is_felt(quick_uri, open_page, tmp_path):
    registered = call("register", quick_uri, "-o", tmp_path / "eye.toml")
    assert registered.exit_code == 0, registered.output
    with Live(quick_uri, "--registration", tmp_path / "eye.toml") as running:
        page = open_page(running.url)
        notice = page.locator("#assumed")
        assert notice.inner_text().startswith("The target is assumed, not measured")
        assert "haptic output is off" in notice.inner_text()
        assert page.locator("#assumed a").get_attribute("href") == "/registration"
        until(page, "document.body.dataset.state === 'retinal_contact'")
        assert page.locator("#amplitude").get_attribute("aria-valuenow") in (None, "0")


def test_a_measured_target_is_not_marked(live, open_page):
    assert open_page(live.url).locator("#assumed").is_hidden()


def test_without_phases_there_are_no_buttons(open_page, live):
    page = open_page(live.url)
    until(page, "page.header")
    assert not page.locator("#phases").is_visible()


def middle_px(element):
    """JavaScript for the horizontal middle of an element."""
    return f"(({{ left, right }}) => (left + right) / 2)({element}.getBoundingClientRect())"


def test_every_state_is_drawn_and_the_current_one_highlighted(live, open_page, procedure):
    page = open_page(live.url)
    assert page.locator("#diagram .node").count() == len(procedure.states)
    diagram, node = "document.querySelector('#diagram')", "document.querySelector('#diagram .node.on')"
    title = f"{node}?.querySelector('title').textContent"
    for name in ("misaligned_retinal_approach", "aligned_retinal_approach"):
        shown = (
            f"document.body.dataset.state === '{name}' && [{title}, {middle_px(node)} < {middle_px(diagram)}]"
        )
        text, is_left = until(page, shown)
        assert name.replace("_", " ") in text
        assert is_left == name.startswith("misaligned")


def test_edges_of_the_graph_appear_and_disappear(live, open_page):
    page = open_page(live.url)
    shown = (
        "[...document.querySelectorAll('#graph .relation.holds text')].map((each) => each.textContent).join()"
    )
    until(page, f"{shown}.includes('touching')")
    until(page, f"!{shown}.includes('touching')")
    until(page, f"{shown}.includes('aligned')")


def test_overlays_can_be_switched(live, open_page):
    page = open_page(live.url)
    until(page, "document.body.dataset.state === 'misaligned_retinal_approach'")
    zone = page.get_by_label("Zones")
    zone.uncheck()
    assert page.evaluate("localStorage.getItem('overlay-zone')") == "0"
    page.reload()
    assert not page.get_by_label("Zones").is_checked()


def test_a_slow_loop_is_not_called_a_slow_connection(live, open_page):
    """Its banner stands at the edge of the picture, which remains useful."""
    page = open_page(live.url)
    until(page, "page.header !== null")
    late = """async (loop_ms) => {
      const { page } = await import("/static/live/live.js"), { Banner } = await import("/static/common/state_panel.js");
      Object.assign(page, { loop_ms, late_ms: 300, wasLate_ms: performance.now(), received_ms: performance.now() });
      const problem = page.problem();
      new Banner().update({ ...problem, isCut: true });
      const heights = ["#banner", "#view"].map((id) => document.querySelector(id).getBoundingClientRect().height);
      return [problem.title, problem.detail, heights[0] / heights[1]];
    }"""
    title, detail, share = page.evaluate(late, 280)
    assert title == "Perception or machine too slow"
    assert detail.startswith("The loop takes 0.3 s for an image; this page's haptic feedback stops after ")
    assert share < 0.1
    title, detail, _ = page.evaluate(late, 20)
    assert title == "Connection too slow"
    assert detail.startswith("Images may be 0.3 s old when they arrive")


def test_the_uncertainty_region_has_a_radius_of_two_standard_deviations(live, open_page):
    """With its size in words; nothing is drawn of a tip whose standard deviation is unknown."""
    page = open_page(live.url)
    until(page, "Object.keys(page.header?.sd_mm ?? {}).includes('needle_tip')")
    until(
        page,
        "/^2 sd (0[.][0-9]{2}|< 0[.]01) mm$/.test(document.querySelector('#overlays .region').textContent)",
    )
    region = page.get_by_label("Uncertainty")
    assert region.is_checked()
    region.uncheck()
    until(page, "document.querySelector('#overlays .region').textContent.endsWith('mm')")
    draw = """async ({ sd_mm, overlays }) => {
      const { View } = await import("/static/common/view.js"), { page } = await import("/static/live/live.js");
      const canvas = document.createElement("canvas"), view = new View(canvas, null);
      canvas.width = canvas.height = 200;
      view.begin({ ...page.hello, anatomy: {}, view: { size_px: 200, half_mm: 10 } });
      view.choose(overlays);
      view.header = { found: { needle_tip: { type: "point", at_mm: [0, 0] } }, sd_mm, edges: [], state: "" };
      view.draw();
      const row = view.context.getImageData(100, 100, 100, 1).data;
      return [Array.from({ length: 100 }, (_, x) => row[4 * x]).findLastIndex((grey) => grey > 0), view.region.textContent];
    }"""
    end_px, words = page.evaluate(draw, {"sd_mm": {"needle_tip": 2}, "overlays": ["uncertainty"]})
    assert abs(end_px - 40) < 3
    assert words == "2 sd 4.00 mm"
    assert page.evaluate(draw, {"sd_mm": {"needle_tip": 2}, "overlays": ["cone"]}) == [-1, "2 sd 4.00 mm"]
    assert page.evaluate(draw, {"sd_mm": {}, "overlays": ["uncertainty"]}) == [-1, "not estimated"]


def test_the_state_shown_is_the_state_recorded(quick_uri, open_page, tmp_path):
    record = tmp_path / "run.mcap"
    with Live(quick_uri, "--record", record) as live:
        page = open_page(live.url)
        page.evaluate(
            """() => { window.shown = {}; const note = () => {
                 window.shown[document.body.dataset.index] = document.getElementById('state').textContent;
                 requestAnimationFrame(note); }; note(); }"""
        )
        until(page, "document.body.dataset.state === 'target_hit'")
        until(page, "document.body.dataset.state === 'outside_eye'")
        shown = page.evaluate("window.shown")
        page.close()
        live.stop()
        close_page(page)
    recorded: dict[str, set[str]] = {}  # a stale image's step has the index of the image before it
    for _, step in RunReader(record).records():
        recorded.setdefault(str(step.index), set()).add(step.conclusion.state.replace("_", " "))
    wrong = {number: label for number, label in shown.items() if label not in recorded.get(number, {label})}
    assert wrong == {}
    assert len(shown.keys() & recorded.keys()) > 20
    assert {"target hit", "retinal contact"} & set(shown.values())


@pytest.mark.slow
def test_another_procedure_is_drawn(quick_uri, open_page, tmp_path):
    docs = (ROOT / "docs/reference/procedures.md").read_text(encoding="utf-8")
    (text,) = [block for block in re.findall(r"```toml\n(.*?)```", docs, re.DOTALL) if "[procedure]" in block]
    procedure = tmp_path / "other.toml"
    procedure.write_text(text)
    with Live(quick_uri, "--procedure", procedure) as live:
        page = open_page(live.url)
        states = evaluate(page, "page.hello.procedure.states.map((state) => state.label)")
        assert page.locator("#diagram .node").count() == len(states)
        page.wait_for_selector("#diagram .node.on")
        until(page, f"new Set({states}).has(document.getElementById('state').textContent)")
        until(page, "document.querySelector('#graph .relation.holds')")
        close_page(page)


def test_the_reason_is_shown(live, open_page):
    page = open_page(live.url)
    until(page, "document.body.dataset.state === 'misaligned_intraocular_navigation'")
    until(
        page,
        "document.getElementById('because').textContent.match(/needle is in the eye and \\d+\\.\\d degrees off/)",
    )


@pytest.mark.slow
def test_a_pause_between_two_pulses_is_no_silence(live, open_page):
    page = open_page(live.url)
    levels = page.evaluate(
        """async () => {
             const { Traces } = await import("/static/common/traces.js");
             const traces = new Traces(document.createElement("canvas"), { now_ms: () => 0 });
             const pattern = (name, on_ms, off_ms) => ({ name, on_ms, off_ms });
             traces.begin({ states: [], relations: [], patterns: [pattern("off", 0, 0), pattern("pulse", 80, 80)] });
             const at = (now_ms, plays) => { traces.now_ms = now_ms; traces.add({ time_ms: now_ms, state: "", measures: {}, plays }); return traces.level(); };
             traces.addEdges([[1000, 1, 160], [1080, 0, 0]]);
             return [at(1050, "pulse"), at(1120, "pulse"), at(1130, "off"), at(1400, "pulse")];
           }"""
    )
    assert levels == [1, 1, 0, 0]


@pytest.mark.slow
def test_the_hint_of_the_first_visit_goes_away_for_good(live, open_page):
    page = open_page(live.url)
    hint = page.locator("#hint")
    assert hint.inner_text().count(".") == 3
    hint.get_by_role("button", name="Got it").click()
    assert hint.count() == 0
    page.reload()
    until(page, "document.body.dataset.index > 0")
    assert hint.count() == 0


def test_a_failed_device_is_shown_and_reported_until_it_responds_again(quick_uri, open_page):
    with Live(
        quick_uri, "--device", "failing", program=(str(ROOT / "tests/dashboard/failing_device.py"),)
    ) as live:
        page = open_page(live.url)
        live.process.send_signal(signal.SIGUSR1)
        page.wait_for_selector("#health li.bad:has-text('device failing: unplugged')")
        live.process.send_signal(signal.SIGUSR2)
        page.wait_for_selector("#health li:not(.bad):text-is('device failing')")
        close_page(page)
        output = live.stop()
    assert output.count("! device: unplugged\n") == output.count(" s  device: responds again\n") == 1


@pytest.mark.slow  # `make test` goes on and restarts the server
def test_a_lost_server_raises_the_banner(quick_uri, open_page):
    with Live(quick_uri) as live:
        page = open_page(live.url)
        live.process.kill()
        page.wait_for_selector("#banner:has-text('Connection lost')")
    close_page(page)


def test_a_page_reconnects_to_a_restarted_server(quick_uri, open_page):
    with Live(quick_uri) as live:
        page, port = open_page(live.url), live.url.rpartition(":")[2].strip("/")
        live.process.kill()
        page.wait_for_selector("#banner:has-text('Connection lost')")
    with Live(quick_uri, "--port", port):
        page.wait_for_selector("#banner", state="hidden")
        until(page, "page.isOpen && page.header && page.header.index >= 0")
    close_page(page)


def test_a_hidden_page_gets_no_images(live, open_page):
    page = open_page(live.url)
    hide(page)
    number = "page.header.number"
    # Images in flight may still arrive; afterwards the number stays the same for a second.
    page.evaluate(
        "() => { window.numbers = []; import('/static/live/live.js').then(({ page }) => setInterval(() => window.numbers.push(page.header.number), 200)); }"
    )
    until(page, "window.numbers.length > 8 && new Set(window.numbers.slice(-5)).size === 1")
    last = evaluate(page, number)
    show(page)
    until(page, f"page.header.number > {last} + 5")
