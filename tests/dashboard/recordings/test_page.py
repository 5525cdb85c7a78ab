"""The recordings page in a real browser, with the real server."""

import csv
import io
import shutil
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from live_bench import Live, close_page, evaluate, until

from haptigraph import assemble
from haptigraph.analysis.archive.index import update_archive
from haptigraph.analysis.metrics.replay import replay
from haptigraph.analysis.metrics.run import measure_run
from haptigraph.analysis.paper.figure import paper_figure
from haptigraph.analysis.plots.figures import run_figure
from haptigraph.config import load_config
from haptigraph.perception.eye_view import IoctView
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration

pytestmark = pytest.mark.browser

MODULE = "/static/recordings/recordings.js"
SMALL = 80  # side of the images that are compared [px]
PIXELS = """(() => {
  const canvas = new OffscreenCanvas(80, 80), c = canvas.getContext("2d");
  c.imageSmoothingQuality = "high";
  c.drawImage(page.moment.view.picture, 0, 0, 80, 80);
  return Array.from(c.getImageData(0, 0, 80, 80).data.filter((_, at) => at % 4 === 0));
})()"""
HOLDS = "[...document.querySelectorAll('#graph .relation.holds text')].map((each) => each.textContent)"


@pytest.fixture(scope="session")
def records(recordings):
    return list(RunReader(recordings / "quick.mcap").records())


def open_run(open_page, live, name="quick.mcap", **options):
    return open_page(
        f"{live.url}recordings#{name}", module=MODULE, ready="document.body.dataset.step === '0'", **options
    )


def open_list(open_page, live):
    return open_page(
        f"{live.url}recordings", module=MODULE, ready="document.querySelector('#runs tr')", size=(1366, 768)
    )


def wait_for_step(page, number):
    until(page, f"document.body.dataset.step === '{number}'", module=MODULE)


def downscaled(picture):
    return cv2.resize(picture, (SMALL, SMALL), interpolation=cv2.INTER_AREA).astype(float)


def test_recordings_are_listed_with_their_outcomes(archive, open_page, recordings):
    page = open_list(open_page, archive)
    until(
        page,
        "[...document.querySelectorAll('#runs tr')].every((row) => !row.textContent.includes('…'))",
        module=MODULE,
    )
    measures = measure_run(step for _, step in RunReader(recordings / "quick.mcap").records(images=()))
    row = page.inner_text("#runs tr:has(a:text-is('quick.mcap'))")
    for part in (
        f"hit after {measures.completion_s:.1f} s",
        "P07",
        "subretinal_injection",
        "phantom:",
        "7.7 s",
    ):
        assert part in row
    assert "not a recording" in page.inner_text("#runs tr:has-text('notes.mcap')")
    assert "haptigraph recover killed.mcap" in page.inner_text("#runs tr:has-text('killed.mcap')")
    assert page.locator("#runs a:text-is('p08/again.mcap')").count() == 1
    assert page.locator("#runs :text('link.mcap')").count() == 0
    page.click("#runs a:text-is('quick.mcap')")
    wait_for_step(page, 0)
    page.go_back()
    page.wait_for_selector("#list:not([hidden])")


def test_seeking_shows_image_state_and_graph_of_the_recorded_step(archive, open_page, recordings, records):
    page = open_run(open_page, archive)
    info = RunReader(recordings / "quick.mcap").info
    view = IoctView(parse_registration(info.registration, "registration"), 560)
    box = page.locator("#timeline").bounding_box()
    middle_s = records[-1][1].stamp_ns / 2e9 - records[0][1].stamp_ns / 2e9
    middle = max(
        number
        for number, (_, step) in enumerate(records)
        if (step.stamp_ns - records[0][1].stamp_ns) / 1e9 <= middle_s
    )
    actions = [
        (lambda: [page.keyboard.press("ArrowRight") for _ in range(3)], 3),
        (lambda: page.keyboard.press("Shift+ArrowRight"), 18),
        (lambda: page.keyboard.press("ArrowLeft"), 17),
        (lambda: page.mouse.click(box["x"] + 244 + (box["width"] - 258) / 2, box["y"] + 60), middle),
        (lambda: page.keyboard.press("Home"), 0),
        (lambda: page.click("#events li:has-text('target hit') >> nth=0"), None),
    ]
    for act, number in actions:
        act()
        if number is None:
            number = next(n for n, (_, step) in enumerate(records) if step.conclusion.state == "target_hit")
        until(
            page,
            f"Math.abs(document.body.dataset.step - {number}) <= {int(number == middle)} && !page.moment.isBusy",
            module=MODULE,
        )
        number = int(page.evaluate("document.body.dataset.step"))
        capture, step = records[number]
        assert page.inner_text("#state").lower() == step.conclusion.state.replace("_", " ")
        assert page.inner_text("#because").lower().startswith(step.conclusion.because.lower())
        assert page.inner_text("#now").endswith(f" s · step {number}")
        predicates = [predicate for text in page.evaluate(HOLDS) for predicate in text.split(" · ")]
        assert sorted(predicates) == sorted(edge.predicate for edge in step.graph.edges)
        shown = np.reshape(evaluate(page, PIXELS, MODULE), (SMALL, SMALL))
        assert np.abs(shown - downscaled(view(capture.image))).mean() < 2
        theta_deg = step.graph.measures.get("theta_deg")
        drawn = evaluate(page, f"page.run.measure('theta_deg')[{number}]", MODULE)
        assert drawn == pytest.approx(theta_deg, abs=1e-4) if theta_deg is not None else np.isnan(drawn)


@pytest.mark.slow  # seeking compares the images of six steps
def test_the_image_is_that_of_the_step(archive, open_page, recordings, records):
    page = open_run(open_page, archive)
    info = RunReader(recordings / "quick.mcap").info
    view = IoctView(parse_registration(info.registration, "registration"), 560)
    for _ in range(2):
        page.keyboard.press("Shift+ArrowRight")
    wait_for_step(page, 30)
    shown = np.reshape(evaluate(page, PIXELS, MODULE), (SMALL, SMALL))
    distances = [
        np.abs(shown - downscaled(view(capture.image))).mean() if capture.image is not None else np.inf
        for capture, _ in records
    ]
    assert int(np.argmin(distances)) == 30


@pytest.mark.slow
def test_space_plays_in_real_time(archive, open_page, records):
    page = open_run(open_page, archive)
    started_ms = page.evaluate("performance.now()")
    page.keyboard.press("Space")
    until(page, "page.player.number >= 20", module=MODULE)
    took_ms = page.evaluate("performance.now()") - started_ms
    page.keyboard.press("Space")
    assert "Play" in page.inner_text("#play")
    number = evaluate(page, "page.player.number", MODULE)
    played_ms = (records[number][1].stamp_ns - records[0][1].stamp_ns) / 1e6
    assert 1000 < played_ms <= took_ms + 1000  # never ahead of the clock
    wait_for_step(page, number)


def test_a_comparison_shows_differences_under_another_procedure(archive, open_page, recordings):
    recorded, replayed = [], []
    path, wide = recordings / "quick.mcap", str(recordings / "wide.toml")
    report = replay(path, wide, watch=lambda a, b: (recorded.append(a), replayed.append(b)))
    differing = [
        n
        for n, (a, b) in enumerate(zip(recorded, replayed, strict=True))
        if a.conclusion.state != b.conclusion.state
    ]
    assert 5 < len(differing) < report.steps
    page = open_run(open_page, archive)
    page.select_option("#other", "wide.toml")
    page.click("#compare")
    page.wait_for_selector("#verdict:not([hidden])", timeout=60_000)
    assert f"the state differs in {len(differing)} of {report.steps} steps" in page.inner_text("#verdict")
    spans = evaluate(page, "page.timeline.differences.filter((each) => each[2])", MODULE)
    assert [number for first, end, _ in spans for number in range(first, end)] == differing
    bounds = "page.timeline.boxes.map(({ strip, compared }) => [strip.measure, strip.band, compared?.band])"
    assert ["theta_deg", 1.7, 4] in evaluate(page, bounds, MODULE)
    page.click("#events button >> nth=0")
    wait_for_step(page, differing[0])
    label = replayed[differing[0]].conclusion.state.replace("_", " ")
    assert f"wide.toml: {label}" in page.inner_text("#instead.differs")
    assert f"{report.replayed.mean_theta_deg:.2f}°" in page.inner_text("#measures")
    page.select_option("#other", "")
    page.click("#compare")
    page.wait_for_selector("#verdict:has-text('117 of 117 are identical')", timeout=60_000)
    assert all(compared is None for *_, compared in evaluate(page, bounds, MODULE))


def test_a_failed_device_is_shown_until_it_responds_again(
    quick_uri, calm_uri, open_page, tmp_path, monkeypatch
):
    monkeypatch.setitem(assemble.DEVICES, "flaky", "own_parts:FlakyDevice")
    record = f'recording.path="{tmp_path}/run.mcap"'
    settings = (f"source.uri={quick_uri}", "run.realtime=false", "haptics.device=flaky:3.0-4.0", record)
    assemble.build(load_config(None, settings)).run()
    with Live(calm_uri, "--recordings", tmp_path) as live:
        page = open_run(open_page, live, "run.mcap")
        (fault,) = evaluate(page, "page.run.content.faults", MODULE)
        assert (fault["message"], fault["ended"]) == ("unplugged", "responds again")
        page.select_option("#which", "fault")
        assert [text.split("\n")[-1] for text in page.locator("#events li").all_inner_texts()] == [
            "device: unplugged",
            "device: responds again",
        ]
        for number, shown in ((fault["last"], "device: unplugged, since"), (fault["last"] + 1, "")):
            evaluate(page, f"page.player.seek({number})", MODULE)
            wait_for_step(page, number)
            assert page.inner_text("#fault").startswith(shown) and page.is_visible("#fault") == bool(shown)
        close_page(page)


@pytest.mark.slow
def test_a_comparison_can_be_stopped(archive, open_page):
    page = open_run(open_page, archive)
    page.click("#compare")
    page.wait_for_selector("#work:not([hidden])")
    page.click("#stop")
    page.wait_for_selector("#tools:not([hidden])")
    assert page.is_hidden("#verdict")
    children = Path(f"/proc/{archive.process.pid}/task")
    if children.exists():
        for _ in range(200):
            if not any(file.read_text().strip() for file in children.glob("*/children")):
                return
            page.wait_for_timeout(50)
        raise AssertionError("the job goes on")


def test_the_csv_agrees_with_the_recording(archive, open_page, records):
    page = open_run(open_page, archive)
    with page.expect_download() as download:
        page.click("#csv")
    assert download.value.suggested_filename == "quick.csv"
    rows = list(csv.DictReader(io.StringIO(Path(download.value.path()).read_text())))
    steps = [step for _, step in records]
    assert len(rows) == len(steps)
    for row, step in zip(rows, steps, strict=True):
        assert (int(row["image"]), int(row["stamp_ns"])) == (step.index, step.stamp_ns)
        assert (row["state"], row["plays"]) == (step.conclusion.state, step.command.pattern.name)
        assert row["because"] == step.conclusion.because
        for name, value in step.graph.measures.items():
            assert float(row[name]) == value
        assert row["relations"].count("<") == len(step.graph.edges)
    measures = measure_run(steps)
    lasted = dict.fromkeys(measures.all_state_s, 0.0)
    for row, later in pairwise(rows):
        lasted[row["state"]] += float(later["time_s"]) - float(row["time_s"])
    assert lasted == pytest.approx(measures.all_state_s)


@pytest.mark.slow
def test_the_png_is_the_figure_of_the_run(archive, open_page, recordings, tmp_path):
    page = open_run(open_page, archive)
    with page.expect_download(timeout=100_000) as download:
        page.click("#png")
    assert download.value.suggested_filename == "quick.png"
    run_figure(recordings / "quick.mcap", tmp_path / "run.png")
    # The title names the recording's source; the rest is the same program on the same data.
    shown, drawn = (cv2.imread(str(path)) for path in (download.value.path(), tmp_path / "run.png"))
    assert np.array_equal(shown, drawn)


@pytest.mark.slow
def test_the_png_of_a_comparison_shows_both(archive, open_page, recordings, tmp_path):
    address = f"{archive.url}recordings#quick.mcap?with=wide.toml"
    page = open_page(address, module=MODULE, ready="document.body.dataset.step === '0'")
    page.wait_for_selector("#verdict:has-text('With wide.toml')", timeout=60_000)
    page.wait_for_selector("#png", state="visible")
    with page.expect_download(timeout=100_000) as download:
        page.click("#png")
    assert download.value.suggested_filename == "quick-wide.png"
    figure = tmp_path / "compared.png"
    paper_figure(recordings / "quick.mcap", "timeline", figure, procedure=str(recordings / "wide.toml"))
    shown, drawn = (cv2.imread(str(path)) for path in (download.value.path(), figure))
    assert np.array_equal(shown, drawn)


@pytest.mark.parametrize("size", [(1366, 768), pytest.param((1920, 1080), marks=pytest.mark.slow)])
def test_everything_is_on_one_screen(archive, open_page, size):
    page = open_run(open_page, archive, size=size)
    until(page, "!document.getElementById('tools').hidden", module=MODULE)
    assert page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    ) == list(size)
    hidden = page.evaluate(
        """[...document.querySelectorAll('#run > .panel, #state, #overlays, #png, #whole, footer')].filter((each) => {
             const box = each.getBoundingClientRect();
             return box.width === 0 || box.bottom > innerHeight + 1 || box.right > innerWidth + 1 || each.scrollWidth > each.clientWidth + 1;
           }).map((each) => each.id || each.className)"""
    )
    assert hidden == []


REFUSED = {
    "notes.mcap": "notes.mcap: not a recording (an MCAP file begins otherwise)",
    "damaged.mcap": "damaged",
    "none.mcap": "none.mcap: does not exist (any more); refresh the list",
    "..%2F..%2Fetc%2Fpasswd": "is not in the folder of recordings",
    "link.mcap": "is not in the folder of recordings",
}


def test_a_refused_recording_is_reported_and_the_next_opens(archive, open_page):
    is_reported = "!document.getElementById('problem').hidden"
    page = open_page(f"{archive.url}recordings#notes.mcap", module=MODULE, ready=is_reported)
    for name, sentence in REFUSED.items():
        page.evaluate(f"location.hash = '#{name}'")
        until(page, is_reported)
        problem = page.inner_text("#problem")
        assert sentence in problem and "\n" not in problem and str(Path.home()) not in problem
        page.evaluate("location.hash = '#quick.mcap'")
        page.wait_for_selector("#problem", state="hidden")
        wait_for_step(page, 0)


def test_an_interrupted_run_opens_with_a_hint_to_repair_it(archive, open_page, recordings):
    page = open_run(open_page, archive, "killed.mcap")
    assert "haptigraph recover killed.mcap" in page.inner_text("#notes")
    last = sum(1 for _ in RunReader(recordings / "killed.mcap").records(images=())) - 1
    page.keyboard.press("End")
    wait_for_step(page, last)


@pytest.mark.slow
def test_a_deleted_recording_is_reported(quick_uri, open_page, recordings, tmp_path):
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((recordings / "quick.mcap").read_bytes())
    with Live(quick_uri, "--recordings", tmp_path) as live:
        page = open_run(open_page, live, "copy.mcap")
        copy.unlink()
        page.keyboard.press("End")
        page.wait_for_selector("#problem:has-text('copy.mcap: does not exist (any more)')")
        page.problems.clear()  # the browser logs the refused request
        close_page(page)


@pytest.mark.parametrize("size", mostly_slow([(1366, 768), (390, 844)], (390, 844)))
def test_an_address_names_a_step_and_a_procedure_to_compare_with(archive, open_page, size):
    address = f"{archive.url}recordings#quick.mcap?step=40&with=wide.toml"
    page = open_page(address, module=MODULE, ready="document.body.dataset.step === '40'", size=size)
    page.wait_for_selector("#verdict:has-text('With wide.toml the state differs in')", timeout=60_000)
    assert page.inner_text("#now").endswith("step 40")
    assert page.input_value("#other") == "wide.toml"
    assert page.evaluate("scrollY") == 0 and page.evaluate("document.querySelector('#events .now') !== null")


def test_the_address_keeps_what_is_chosen_on_the_page(archive, open_page):
    page = open_run(open_page, archive)
    until(page, "location.hash === '#quick.mcap?step=0'", module=MODULE)
    page.select_option("#other", "wide.toml")
    page.click("#compare")
    page.wait_for_selector("#verdict:not([hidden])", timeout=60_000)
    page.keyboard.press("ArrowRight")
    until(page, "location.hash === '#quick.mcap?step=1&with=wide.toml'", module=MODULE)
    page.reload()
    page.wait_for_selector("#verdict:has-text('With wide.toml')", timeout=60_000)
    wait_for_step(page, 1)
    page.select_option("#other", "")
    page.click("#compare")
    page.wait_for_selector("#verdict:has-text('are identical')", timeout=60_000)
    until(page, "location.hash === '#quick.mcap?step=1&with='", module=MODULE)
    page.click("#back")
    page.wait_for_selector("#list:not([hidden])")
    assert page.evaluate("location.hash") == ""


@pytest.mark.slow  # `make test` finds them in test_folder.py
def test_the_form_finds_recordings_and_links_to_the_first_step(quick_uri, open_page, recordings, tmp_path):
    folder = Path(shutil.copytree(recordings, tmp_path / "recordings", symlinks=True))
    update_archive(folder)
    with Live(quick_uri, "--recordings", folder) as live:
        page = open_list(open_page, live)
        page.click("#finder summary")
        page.fill("#find-form [name=measure] >> nth=0", "theta_deg")
        page.fill("#find-form [name=value] >> nth=0", "5")
        page.fill("#find-form [name=measure] >> nth=1", "distance_to_retina_mm")
        page.fill("#find-form [name=value] >> nth=1", "3")
        page.click("#find-form button")
        page.wait_for_selector("#found a")
        assert page.inner_text("#found-count") == "3 recordings"
        steps = [step for _, step in RunReader(folder / "quick.mcap").records(images=())]
        first = next(
            number
            for number, step in enumerate(steps)
            if step.graph.measures.get("theta_deg", 0) > 5
            and step.graph.measures["distance_to_retina_mm"] < 3
        )
        page.click("#found a:text-is('quick.mcap')")
        wait_for_step(page, first)
        close_page(page)
