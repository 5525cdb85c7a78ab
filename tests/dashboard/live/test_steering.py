"""Steering from the page: keyboard, controller, mouse; who has the controls."""

import math

import pytest
from live_bench import Live, evaluate, until
from paths import DATA

pytestmark = pytest.mark.browser

OFF_AXIS_DEG = """
  const line = page.header?.found.needle_line;
  if (!line) return null;
  const trocar = page.hello.anatomy.trocar.at_mm, target = page.hello.anatomy.retina_target.at_mm;
  const angle = (from, to) => Math.atan2(to[1] - from[1], to[0] - from[0]);
  const off = (angle(line.start_mm, line.end_mm) - angle(trocar, target)) * 180 / Math.PI;
  return (off + 540) % 360 - 180;
"""
"""Angle of the shaft from the line trocar -> target, counter-clockwise."""


@pytest.fixture
def steered(open_page, steered_uri):
    with Live(steered_uri) as live:
        page = open_page(live.url, pad=True)
        page.wait_for_selector("#holder:has-text('You have the controls')")
        page.live = live
        yield page
        open_page.close_all()  # while the server still runs


@pytest.fixture(scope="session")
def steered_uri(tmp_path_factory):
    """A scenario with small images, in which the needle is outside."""
    text = (DATA / "steered.toml").read_text()
    path = tmp_path_factory.mktemp("steered") / "outside.toml"
    path.write_text(text.replace("depth_mm = 8.0", "depth_mm = -4.0"))
    return f"teleop:{path}"


def wait_in_state(page, name):
    until(page, f"document.body.dataset.state === '{name}'")


def off_axis_deg(page):
    return evaluate(page, f"await (async () => {{ {OFF_AXIS_DEG} }})()")


def hold_until(page, keys, condition):
    """Hold keys down until a condition of the shaft angle `off` or of the state is true."""
    for key in keys:
        page.keyboard.down(key)
    until(
        page,
        f"(async () => {{ const off = await (async () => {{ {OFF_AXIS_DEG} }})(); return {condition}; }})()",
    )
    for key in keys:
        page.keyboard.up(key)
    until(page, "page.header.hand?.engaged === false")


def align(page):
    """Align the shaft with the target, by arrow keys in fine motion."""
    while abs(off := off_axis_deg(page) or 0.0) > 0.8:
        key, reached = ("ArrowLeft", "off < 0.3") if off > 0 else ("ArrowRight", "off > -0.3")
        key = (
            key
            if turns_counterclockwise(page)
            else {"ArrowLeft": "ArrowRight", "ArrowRight": "ArrowLeft"}[key]
        )
        hold_until(page, ["Shift", key], f"off !== null && {reached}")


def turns_counterclockwise(page):
    """Return whether moving the tip right turns the shaft counter-clockwise, as with a needle from above."""
    line = evaluate(page, "page.header.found.needle_line")
    return line["end_mm"][1] < line["start_mm"][1]


@pytest.mark.slow  # `make test` steers from within the eye, in test_keyboard.py
def test_the_keyboard_drives_the_needle_from_outside_to_the_target(steered):
    page = steered
    assert page.get_attribute("body", "data-state") in ("outside_eye", "unknown")
    hold_until(page, ["ArrowDown"], "(document.body.dataset.state ?? '').includes('intraocular')")
    hold_until(page, ["ArrowDown"], "page.header.measures.wall_mm > 8")
    align(page)
    wait_in_state(page, "aligned_intraocular_navigation")
    hold_until(page, ["ArrowDown"], "document.body.dataset.state === 'aligned_retinal_approach'")
    align(page)
    while (
        page.get_attribute("body", "data-state") != "target_hit"
    ):  # the first contact may last one image only
        hold_until(page, ["Shift", "ArrowDown"], "document.body.dataset.state === 'target_hit'")
    assert page.inner_text("#state").lower() == "target hit"
    assert math.isclose(off_axis_deg(page) or 0.0, 0.0, abs_tol=1.7)


def test_a_stick_moves_the_needle_until_it_is_released(steered):
    page = steered
    page.evaluate("window.pad.axes[1] = 1")
    wait_in_state(page, "misaligned_intraocular_navigation")
    assert "moving" in page.inner_text("#clutch")
    page.evaluate("window.pad.axes[1] = 0.05")  # within the dead zone
    until(page, "document.getElementById('clutch').textContent.includes('disengaged')")
    until(page, "page.header.hand?.engaged === false")
    first = evaluate(page, "page.header.index")
    before = evaluate(page, "page.header.found.needle_tip.at_mm")
    until(page, f"page.header.index > {first} + 10")
    after = evaluate(page, "page.header.found.needle_tip.at_mm")
    assert math.dist(before, after) < 0.3


def check_disengaged_then_hold_clutch(page):
    index = evaluate(page, "page.header.index")
    until(page, f"page.header.index > {index} + 10")
    assert evaluate(page, "page.header.hand.engaged") is False
    page.evaluate("window.pad.buttons[7].value = 1")


@pytest.mark.slow
def test_a_required_clutch_blocks_the_stick_until_the_trigger_is_held(steered):
    page = steered
    page.get_by_label("Needs clutch").check()
    page.evaluate("window.pad.axes[1] = 1")
    check_disengaged_then_hold_clutch(page)
    until(page, "page.header.hand.engaged")


def test_dragging_in_the_picture_moves_the_needle(steered):
    page = steered
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 100, box["y"] + 250, steps=40)
    until(page, "page.header.hand.engaged")
    page.mouse.up()
    until(page, "!page.header.hand.engaged")


@pytest.mark.slow
def test_a_mapping_to_another_axis_is_remembered(steered):
    page = steered
    page.click("#map")
    page.click("button[aria-label='Change into the eye']")
    page.evaluate("window.pad.axes[3] = -1")
    page.wait_for_selector("#actions tr:has-text('into the eye'):has-text('axis 3, inverted')")
    page.evaluate("window.pad.axes[3] = 0")
    page.click("#mapping button.primary")
    page.reload()
    page.wait_for_selector("#holder:has-text('You have the controls')")
    page.evaluate("window.pad.axes[3] = -1")
    wait_in_state(page, "misaligned_intraocular_navigation")


@pytest.mark.slow
def test_scale_and_filter_change_at_run_time_for_every_viewer(steered, open_page):
    page, other = steered, open_page(steered.live.url)
    page.get_by_label("Tremor filter").check()
    page.locator("#scale").fill("0.5")
    other.wait_for_selector("#scale-value:has-text('0.50')", state="attached")
    until(other, "document.getElementById('filter').checked")
    until(
        page,
        "page.header.hand.motion_scale === 0.5 && page.header.hand.tremor_filter",
    )


@pytest.mark.slow
def test_two_changes_before_an_answer_both_apply(steered):
    steered.evaluate("""() => {
      const filter = document.getElementById("filter"), scale = document.getElementById("scale");
      filter.click();
      scale.value = 0.5;
      scale.dispatchEvent(new Event("input"));
    }""")
    until(steered, "page.header.hand.motion_scale === 0.5")
    assert evaluate(steered, "page.header.hand.tremor_filter") is True


def test_one_page_has_the_controls_and_the_others_show_which(steered, open_page):
    page, other = steered, open_page(steered.live.url)
    other.wait_for_selector("#holder:has-text('page 1 has the controls')")
    assert other.is_disabled("#hold")
    other.keyboard.down("ArrowDown")
    index = evaluate(other, "page.header.index")
    until(other, f"page.header.index > {index} + 10")
    assert evaluate(other, "page.header.hand.engaged") is False
    other.keyboard.up("ArrowDown")
    page.click("#hold")  # release
    other.wait_for_selector("#holder:has-text('Nobody')")
    other.click("#hold")
    page.wait_for_selector("#holder:has-text('page 2 has the controls')")


def test_a_closed_or_hidden_page_releases_the_controls(steered, open_page):
    from live_bench import hide

    other = open_page(steered.live.url)
    steered.keyboard.down("ArrowDown")
    until(other, "page.header.hand.engaged")
    hide(steered)
    other.wait_for_selector("#holder:has-text('Nobody')")
    until(other, "!page.header.hand.engaged")
    other.click("#hold")
    other.wait_for_selector("#holder:has-text('You have')")
    third = open_page(steered.live.url)
    third.wait_for_selector("#holder:has-text('page 2')")
    other.close()
    third.wait_for_selector("#holder:has-text('Nobody')")


# --- jaws


@pytest.fixture
def forceps(open_page):
    """A page that steers forceps, which point at the edge of a membrane."""
    scenario = DATA / "peeled.toml"
    with Live(f"teleop:{scenario}", "--procedure", "membrane_peeling") as live:
        page = open_page(live.url, pad=True)
        page.wait_for_selector("#holder:has-text('You have the controls')")
        yield page
        open_page.close_all()


def press_until(page, keys, condition):
    """Hold keys down until a condition of the measures or of the state is true."""
    for key in keys:
        page.keyboard.down(key)
    until(page, f"((measures) => {condition})(page.header.measures)")
    for key in keys:
        page.keyboard.up(key)
    until(page, "page.header.hand?.engaged === false")


BEYOND_EDGE = """(({forceps_line, membrane_edge}) => {
  const [x, y] = forceps_line.start_mm;
  const away = ([at_x, at_y]) => Math.hypot(at_x - x, at_y - y);
  return away(forceps_line.end_mm) > away(membrane_edge.at_mm);
})(page.header.found)"""
"""Whether the jaws are beyond the edge; both are visible."""


def distance_to_edge_mm(page):
    """The distance in the next image in which both are visible."""
    distance = "page.header.measures.distance_to_edge_mm"
    return until(page, f"{distance} != null && [{distance}]")[0]


def bring_to_the_edge(page):
    """Move down in fine motion, and up if a slow machine noticed too late that the jaws passed the edge."""
    while distance_to_edge_mm(page) > 0.25:
        is_beyond = evaluate(page, BEYOND_EDGE)
        passed = f"({BEYOND_EDGE}) !== {str(is_beyond).lower()}"
        key = "ArrowUp" if is_beyond else "ArrowDown"
        press_until(page, ["Shift", key], f"measures.distance_to_edge_mm < 0.2 || {passed}")


@pytest.mark.slow  # sources/test_steered.py peels one by steps
def test_the_keyboard_peels_a_membrane(forceps):
    page = forceps
    press_until(page, ["o"], "measures.opening_mm > 1.2")
    press_until(page, ["ArrowDown"], f"document.body.dataset.state === 'open_approach' || {BEYOND_EDGE}")
    bring_to_the_edge(page)
    wait_in_state(page, "edge_between_jaws")
    index = evaluate(page, "page.header.index")
    press_until(page, ["c"], f"page.header.index > {index} + 30 && document.body.dataset.state === 'grasped'")
    press_until(page, ["ArrowUp"], "document.body.dataset.state === 'peeling'")
    assert page.inner_text("#state").lower() == "peeling"


@pytest.mark.slow
def test_shoulder_buttons_move_the_jaws_until_released(forceps):
    page = forceps
    page.evaluate("window.pad.buttons[5].value = 1")
    until(page, "page.header.measures.opening_mm > 1")
    page.evaluate("window.pad.buttons[5].value = 0")
    until(page, "page.header.hand?.engaged === false")
    index, before_mm = evaluate(page, "page.header.index"), evaluate(page, "page.header.measures.opening_mm")
    until(page, f"page.header.index > {index} + 10")
    assert evaluate(page, "page.header.measures.opening_mm") == pytest.approx(before_mm, abs=0.15)
    page.get_by_label("Needs clutch").check()
    page.evaluate("window.pad.buttons[4].value = 1")
    check_disengaged_then_hold_clutch(page)
    until(page, "page.header.measures.opening_mm < 0.5")


@pytest.mark.slow
def test_jaw_controls_are_shown_for_forceps_only(forceps, open_page, steered_uri):
    with Live(steered_uri) as live:
        needle = open_page(live.url, pad=True)
        for page, count in ((forceps, 2), (needle, 0)):
            assert page.locator("#jaws").is_visible() is (count > 0)
            page.click("#map")
            assert page.locator("#actions tr:has-text('jaws')").count() == count
            page.click("#mapping button.primary")
        needle.keyboard.down("o")
        index = evaluate(needle, "page.header.index")
        until(needle, f"page.header.index > {index} + 10")
        assert evaluate(needle, "page.header.hand.engaged") is False
        open_page.close_all()
