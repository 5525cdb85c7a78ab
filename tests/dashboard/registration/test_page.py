"""The registration page in a real browser: detect, drag, save, and use in a run."""

import math
import re

import cv2
import pytest
from helpers import call
from live_bench import Live
from playwright.sync_api import expect
from registering import write_clip, write_eye, write_noise

from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import load_registration

pytestmark = pytest.mark.browser

OPEN_TIMEOUT_MS = 90_000
VALID = re.compile(r"Valid registration: 0\.\d{5} mm/px\.")


@pytest.fixture
def page(chromium, live):
    """The page of a server that runs a loop on another source."""
    problems = []
    context = chromium.new_context(viewport={"width": 1366, "height": 768})
    context.add_init_script("localStorage.setItem('hint-registration', 'closed')")
    page = context.new_page()
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda message: page.errors.append(message.text) if message.type == "error" else None)
    page.errors = []
    page.goto(f"{live.url}registration")
    expect(page.locator("#source-input")).not_to_have_value("")
    yield page
    context.close()
    assert problems == []


def open_source(page, source):
    page.fill("#source-input", str(source))
    page.click("text=Find the eye")
    expect(page.locator("#verdict")).to_have_text(VALID, timeout=OPEN_TIMEOUT_MS)


def at(page, key):
    """Return the position of a handle in the image [px]."""
    label = page.locator(f'[data-key="{key}"]').get_attribute("aria-label")
    return tuple(float(number) for number in re.search(r"(-?[\d.]+), (-?[\d.]+) px$", label).groups())


def middle(page, key):
    box = page.locator(f'[data-key="{key}"] .area').bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag(page, key, step_px, *, drops=True):
    """Drag a handle by a step in the image [px]."""
    scale = page.evaluate("document.getElementById('overlay').getScreenCTM().a")
    x, y = middle(page, key)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + step_px[0] * scale, y + step_px[1] * scale, steps=5)
    if drops:
        page.mouse.up()


def error_px(page, what):
    """Return the error that the table shows."""
    return float(page.locator("#rows tr", has_text=re.compile(f"^{what}")).locator("td").nth(1).inner_text())


def save(page, path, *, picture=True):
    page.fill("#path", str(path))
    page.set_checked("#picture", picture)
    page.click("#save-button")


def test_a_click_on_the_target_states_it(page, quick, tmp_path):
    (tmp_path / "clip").mkdir()
    open_source(page, write_clip(tmp_path / "clip", quick))
    target = page.locator("#rows tr", has_text=re.compile("^Target"))
    expect(target.locator("td").nth(1)).to_have_text("")
    expect(page.locator("#rows")).to_contain_text(
        "assumed, not measured: click it if it is right, or drag it"
    )
    save(page, tmp_path / "assumed.toml", picture=False)
    expect(page.locator("#verdict")).to_contain_text("Saved")
    assert "target" in load_registration(tmp_path / "assumed.toml").assumed
    place = at(page, "target")
    page.mouse.click(*middle(page, "target"))
    expect(target.locator("td").nth(1)).to_have_text("0.00")
    assert at(page, "target") == place
    save(page, tmp_path / "stated.toml", picture=False)
    expect(page.locator("#verdict")).to_contain_text("stated.toml")
    assert "target" not in load_registration(tmp_path / "stated.toml").assumed
    page.click("#undo")
    page.locator('[data-key="target"]').press("Enter")
    expect(target.locator("td").nth(1)).to_have_text("0.00")


def test_a_dragged_registration_is_used_by_a_run(page, quick, quick_uri, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    expect(page.locator("#note")).to_have_text(re.compile("which trocar is in use"))
    assert error_px(page, "Globe") < 0.5
    page.get_by_label("right in use").check()
    before = at(page, "target")
    drag(page, "target", (-15, -4))
    expect(page.locator("#verdict")).to_have_text(VALID)
    drag(page, "trocar 0", (2, 1))
    expect(page.locator("#rows")).to_contain_text("from its port opening")
    expect(page.locator("#verdict")).to_have_text(VALID)
    dragged = at(page, "target")
    assert math.dist(before, dragged) == pytest.approx(15, abs=1.5)
    out = tmp_path / "made.toml"
    save(page, out)
    drawn = out.with_suffix(".png")
    expect(page.locator("#verdict")).to_have_text(f"Saved: {out} and {drawn}. Use it with --registration.")
    assert cv2.imread(str(drawn)).shape == (270, 480, 3)
    saved = load_registration(out)
    assert saved.image.to_px(saved.target.at_mm) == pytest.approx(dragged, abs=0.06)
    assert saved.trocar.at_mm[0] > 0
    result = call("run", quick_uri, "--registration", out, "--fast")
    assert result.exit_code == 0, result.output
    assert "source ended" in result.output or "steps" in result.output


def test_saving_a_registration_starts_the_loop(chromium, quick, tmp_path):
    write_clip(tmp_path, quick)
    with Live(tmp_path, "--set", "source.rate_hz=2") as live:
        page = chromium.new_page()
        page.goto(live.url)
        assert page.url.endswith("/registration")
        expect(page.locator("#verdict")).to_have_text(VALID, timeout=OPEN_TIMEOUT_MS)
        expect(page.locator("#note")).to_be_hidden()
        assert "shaft lines" in page.inner_text("#rows")
        save(page, tmp_path / "made.toml", picture=False)
        page.wait_for_url(live.url, timeout=30_000)
        expect(page.locator("nav a[aria-current=page]")).to_have_text("Live")
        expect(page.locator("#state")).not_to_have_text("connecting", timeout=30_000)
        expect(page.locator("nav a")).to_have_text(["Live", "Registration", "Recordings"])
        page.close()
        output = live.stop()
    assert "Traceback" not in output
    load_registration(tmp_path / "made.toml")
    assert not (tmp_path / "made.png").exists()


@pytest.mark.slow
def test_trocars_are_added_renamed_selected_and_removed(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    names = page.locator("#trocars input[type=text]")
    expect(names).to_have_count(2)
    page.click("text=Add trocar")
    expect(names).to_have_count(3)
    assert page.evaluate("document.activeElement.dataset.key") == "trocar 2"
    handles = page.locator(".handle").evaluate_all("(all) => all.map((each) => each.dataset.key)")
    assert handles[:3] == ["center", "radius east", "radius west"]
    assert handles[-4:] == ["trocar 0", "trocar 1", "trocar 2", "target"]
    page.keyboard.press("ArrowDown")
    expect(page.locator("#verdict")).to_have_text(VALID)
    names.nth(2).fill(names.nth(0).input_value())
    assert names.nth(2).evaluate("(input) => input.validationMessage") == "Another trocar has this name."
    names.nth(2).fill("temporal ü")
    page.get_by_label("temporal ü in use").check()
    expect(page.locator("#rows")).to_contain_text("Trocar temporal ü, in use")
    page.get_by_label("Remove left").click()
    expect(names).to_have_count(2)
    page.click("#undo")
    expect(names).to_have_count(3)
    page.locator('[data-key="trocar 0"]').focus()
    page.keyboard.press("Delete")
    expect(names).to_have_count(2)
    expect(page.locator("#verdict")).to_have_text(VALID)
    out = tmp_path / "made.toml"
    save(page, out)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Saved: "))
    saved = anatomy_px(load_registration(out))
    assert [(each.name, each.used) for each in saved.trocars][-1] == ("temporal ü", True)
    page.get_by_role("button", name=re.compile("^Remove (left|right)")).click()
    expect(page.get_by_role("button", name=re.compile("^Remove"))).to_be_disabled()


@pytest.mark.slow
def test_a_loaded_file_is_corrected_and_undone(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    found = at(page, "target")
    drag(page, "target", (20, -4))
    expect(page.locator("#verdict")).to_have_text(VALID)
    out = tmp_path / "made.toml"
    save(page, out)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Saved: "))
    dragged = at(page, "target")
    page.click("#restore")
    assert at(page, "target") == pytest.approx(found, abs=0.06)
    page.click("#load")
    expect(page.locator("#note")).to_have_text(re.compile("^Loaded made.toml"))
    assert at(page, "target") == pytest.approx(dragged, abs=0.06)
    expect(page.locator("#verdict")).to_have_text(VALID)
    page.click("#undo")
    assert at(page, "target") == pytest.approx(found, abs=0.06)
    out.write_text(out.read_text().replace("width = 480", "width = 640"))
    page.click("#load")
    expect(page.locator("#note")).to_have_text(
        f"{out}: is for images of 640 x 270 px, but this one is 480 x 270 px"
    )
    out.write_text("format = [")
    page.click("#load")
    expect(page.locator("#note")).to_have_text(re.compile(f"^{out}, .*: not valid TOML: "))
    assert at(page, "target") == pytest.approx(found, abs=0.06)


@pytest.mark.slow
def test_keys_move_half_a_pixel_or_five_and_are_undone(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    x, y = at(page, "target")
    page.locator('[data-key="target"]').focus()
    page.keyboard.press("ArrowRight")
    assert at(page, "target") == pytest.approx((x + 0.5, y), abs=0.11)
    expect(page.locator("#loupe")).to_be_visible()
    page.keyboard.press("Shift+ArrowLeft")
    assert at(page, "target") == pytest.approx((x - 4.5, y), abs=0.11)
    page.keyboard.press("Control+z")
    assert at(page, "target") == pytest.approx((x, y), abs=0.11)
    page.click("#redo")
    assert at(page, "target") == pytest.approx((x - 4.5, y), abs=0.11)
    page.click("#restore")
    assert at(page, "target") == pytest.approx((x, y), abs=0.11)
    page.locator("#source-input").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.dataset.key") == "center"
    x, y = at(page, "center")
    page.keyboard.press("ArrowDown")
    assert at(page, "center") == pytest.approx((x, y + 0.5), abs=0.11)


@pytest.mark.slow
def test_the_error_follows_a_drag_under_the_loupe(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    drag(page, "center", (8, 0), drops=False)
    expect(page.locator("#loupe")).to_be_visible()
    expect(page.locator("#rows")).to_contain_text("RMS")
    page.mouse.up()
    expect(page.locator("#loupe")).to_be_hidden()
    expect(page.locator("#rows td").nth(1)).to_have_text(re.compile(r"5\.[5-8]\d"))  # 8 / sqrt 2
    page.click("#undo")  # the whole drag
    expect(page.locator("#rows td").nth(1)).to_have_text(re.compile(r"0\.\d\d"))
    expect(page.locator("#undo")).to_be_disabled()
    radius = "radius east"
    drag(page, radius, (6, 0))
    expect(page.locator("#rows td").nth(1)).to_have_text(re.compile(r"[56]\.\d\d"))


def test_a_search_can_be_cancelled(page):
    page.fill("#source-input", "phantom:wrong_place_then_hit")
    page.click("text=Find the eye")
    expect(page.locator("#doing")).to_have_text(re.compile(r"^[A-Z].*\d+ images, \d+ s$"))
    expect(page.locator("#done")).to_be_visible()
    page.click("text=Cancel")
    expect(page.locator("#note")).to_have_text(re.compile("^The search was cancelled"))
    expect(page.locator("#done")).to_be_hidden()
    expect(page.locator("#find")).to_be_enabled()
    assert page.errors == []


def test_a_reloaded_page_goes_on_with_the_search_and_then_keeps_its_result(page, quick, tmp_path):
    source = str(write_clip(tmp_path, quick))
    numbers = []
    page.on("request", lambda each: numbers.append(each.url) if "/picture/" in each.url else None)
    page.fill("#source-input", source)
    page.click("text=Find the eye")
    expect(page.locator("#stop")).to_be_visible()
    for _ in range(2):  # during the search, and after it
        page.reload()
        expect(page.locator("#verdict")).to_have_text(VALID, timeout=OPEN_TIMEOUT_MS)
        expect(page.locator("#source-input")).to_have_value(source)
    assert len(numbers) == 2 and len(set(numbers)) == 1  # one search, shown twice


def test_an_invalid_draft_cannot_be_saved(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    drag(page, "retina 0", (0, 30))
    expect(page.locator("#verdict")).to_have_text(
        re.compile(r"contour point \d+ (lies .* mm outside|goes back)")
    )
    expect(page.locator("#save-button")).to_be_disabled()
    page.click("#undo")
    expect(page.locator("#verdict")).to_have_text(VALID)
    expect(page.locator("#save-button")).to_be_enabled()


@pytest.mark.slow
def test_without_detection_everything_is_placed_by_hand(page, tmp_path):
    open_source(page, write_noise(tmp_path))
    expect(page.locator("#note")).to_have_text(
        re.compile(
            "Automatic registration failed: no eye in the picture: .* You can place everything by hand"
        )
    )
    before = at(page, "center")
    drag(page, "center", (-30, 10))
    drag(page, "radius east", (-12, 0))
    drag(page, "trocar 0", (2, 2))
    expect(page.locator("#verdict")).to_have_text(VALID)
    out = tmp_path / "hand.toml"
    save(page, out)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Saved: "))
    saved = load_registration(out)
    assert saved.image.center_px == pytest.approx((before[0] - 30, before[1] + 10), abs=0.6)
    assert 12 / saved.image.mm_per_px == pytest.approx(0.36 * 270 - 12, abs=0.6)


@pytest.mark.slow
def test_a_refused_source_keeps_the_open_one(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    page.fill("#source-input", str(tmp_path / "gone.mp4"))
    page.click("text=Find the eye")
    expect(page.locator("#note")).to_have_text(re.compile("gone.mp4: file not found; "))
    assert page.locator('[data-key="target"]').count() == 1
    expect(page.locator("#save-button")).to_be_enabled()


@pytest.mark.slow  # test_keyboard.py overwrites one
def test_an_existing_file_is_overwritten_after_confirmation(page, quick, tmp_path):
    open_source(page, write_eye(tmp_path, quick))
    out = tmp_path / "made.toml"
    out.write_text("precious")
    save(page, out)
    expect(page.locator("#exists-title")).to_have_text(f"{out}: already exists.")
    expect(page.get_by_role("button", name="Keep file")).to_be_focused()
    assert page.locator("#exists .primary").all_inner_texts() == ["Keep file"]
    assert page.errors == []  # an existing file is a question, not a failed request
    page.click("text=Keep file")
    expect(page.locator("#exists")).to_be_hidden()
    assert out.read_text() == "precious"
    page.click("#save-button")
    page.click("text=Overwrite")
    expect(page.locator("#verdict")).to_have_text(re.compile("^Saved: "))
    load_registration(out)


@pytest.mark.parametrize(
    "size",
    [
        (1366, 660),
        pytest.param((1366, 768), marks=pytest.mark.slow),
        pytest.param((1920, 1080), marks=pytest.mark.slow),
    ],
)
def test_everything_is_on_one_screen(page, quick, tmp_path, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    open_source(page, write_eye(tmp_path, quick))
    assert page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    ) == list(size)
    for name in ("#save-button", "#verdict", "#anatomy", "#undo"):
        box = page.locator(name).bounding_box()
        assert box["x"] + box["width"] <= size[0] and box["y"] + box["height"] <= size[1], name
