"""A robot steered from the page: only from this machine, and only while the dead-man is held."""

import json
from contextlib import contextmanager

import ifaddr
import pytest
from helpers import call, mostly_slow
from live_bench import Live, hide, until
from visiting import next_text, watching

from haptigraph.robot.simulated import EXAMPLE_SETUP

TOKEN = "steer-me"


@pytest.fixture(scope="module")
def setup(tmp_path_factory):
    """The simulated robot's setup; its dead-man is patient, for machines under load."""
    path = tmp_path_factory.mktemp("robot") / "robot.toml"
    eye = EXAMPLE_SETUP.eye
    path.write_text(
        f"[rcm]\nat_mm = {list(EXAMPLE_SETUP.rcm.at_mm)}\n[eye]\ntranslation_mm = {list(eye.translation_mm)}\n"
        f"quaternion = {list(eye.quaternion)}\n[limits]\ndeadman_ms = 250.0\n"
    )
    return path


def serve(setup, source, *options):
    return Live(
        source, "--robot", "simulated", "--robot-setup", setup, "--steer", "--home", "--no-browser", *options
    )


@pytest.fixture
def page(open_page, setup, quick_uri):
    with serve(setup, quick_uri) as live:
        page = open_page(live.url, pad=True)
        page.wait_for_selector("#holder:has-text('You have the controls')")
        yield page
        open_page.close_all()


def robot_says(page, text):
    page.wait_for_selector(f"#robot:has-text('{text}')")


def start(page):
    """Move the robot by the keyboard; on a machine under load motion may have to be switched on again."""
    page.wait_for_selector("#robot-switch:enabled")
    page.keyboard.down("Space")
    page.keyboard.down("ArrowDown")
    for _ in range(20):
        page.click("#robot-switch")
        try:
            page.wait_for_selector("#robot.moving", timeout=1500)
            return
        except Exception:
            continue
    raise AssertionError(page.inner_text("#robot"))


@pytest.mark.browser
def test_the_switch_starts_off_and_nothing_moves_without_a_held_dead_man(page):
    robot_says(page, "The enable switch is off")
    assert page.inner_text("#robot-switch") == "Enable motion"
    assert "Research software, not a medical device" in page.inner_text("#robot")
    page.keyboard.down("ArrowDown")
    page.evaluate("window.pad.axes[1] = 1")
    robot_says(page, "The enable switch is off")
    page.click("#robot-switch")
    page.wait_for_selector("#robot-switch:has-text('Disable motion')")
    robot_says(page, "the clutch is released")
    assert page.evaluate("document.querySelector('#robot').classList.contains('moving')") is False
    assert "disengaged" in page.inner_text("#clutch")


@pytest.mark.browser
def test_the_robot_moves_while_the_key_is_held(page):
    start(page)
    page.keyboard.up("Space")
    robot_says(page, "■ held")
    page.wait_for_selector("#robot:not(.moving)")


@pytest.mark.slow  # `make test` holds the key
@pytest.mark.browser
def test_the_button_is_a_dead_man_too(page):
    page.wait_for_selector("#robot-switch:enabled")
    page.click("#robot-switch")
    box = page.locator("#deadman").bounding_box()
    page.mouse.move(box["x"] + 10, box["y"] + 10)
    page.mouse.down()
    page.wait_for_selector("#clutch:has-text('dead-man held')")
    page.mouse.up()
    page.wait_for_selector("#clutch:has-text('disengaged')")


@pytest.mark.browser
def test_a_window_that_loses_focus_releases_until_everything_was_let_go(page):
    start(page)
    page.evaluate("window.pad.buttons[7].value = 1")
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    page.wait_for_selector("#clutch:has-text('disengaged')")
    page.wait_for_selector("#robot:not(.moving)")
    for _ in range(5):  # neither the trigger nor a key that repeats counts
        page.keyboard.down("Space")
        assert "disengaged" in page.inner_text("#clutch")
    page.keyboard.up("Space")
    assert "disengaged" in page.inner_text("#clutch")
    page.evaluate("window.pad.buttons[7].value = 0")
    until(page, "new Promise((resolve) => setTimeout(resolve, 100, true))")
    page.evaluate("window.pad.buttons[7].value = 1")
    page.wait_for_selector("#clutch:has-text('dead-man held')")


@pytest.mark.browser
@pytest.mark.parametrize(
    "leave", mostly_slow([lambda page: page.close(), hide], hide), ids=["closed", "hidden"]
)
def test_a_page_that_is_left_switches_motion_off(page, open_page, leave):
    url = page.url
    start(page)
    leave(page)
    other = open_page(url)
    robot_says(other, "The enable switch is off")


# --- other machines, without a browser


def own_address():
    """An address of this machine that is not loopback, from which the server sees a visitor of another machine."""
    for adapter in ifaddr.get_adapters():
        for ip in adapter.ips:
            if ip.is_IPv4 and not ip.ip.startswith("127."):
                return ip.ip
    pytest.skip("this machine has no address but loopback")


@contextmanager
def visit(live, host, **headers):
    """Open the page's socket at an address of this machine."""
    port = live.url.split(":")[2].partition("/")[0]

    class At:
        url = f"http://{host}:{port}/"

    headers = {"Cookie": f"haptigraph_token={TOKEN}", **headers}
    with watching(At, additional_headers=headers) as line:
        yield line


def ask(line, **message):
    line.send(json.dumps(message))


@pytest.mark.parametrize("allowed", [False, True])
def test_a_page_of_another_machine_moves_a_robot_only_with_the_option(setup, quick_uri, allowed):
    address = own_address()
    options = ("--host", "0.0.0.0", "--token", TOKEN, *["--allow-remote-motion"] * allowed)
    with serve(setup, quick_uri, *options) as live:
        with visit(live, address) as line:
            welcome = next_text(line, "welcome")
            assert welcome["may_steer"] is allowed
            assert ("--allow-remote-motion" in welcome["refusal"]) is not allowed
            ask(line, type="take_controls")
            ask(line, type="switch_robot", on=True)
            if allowed:
                while not next_text(line, "robot")["is_switched_on"]:
                    pass
                return
            assert "this page cannot move the robot" in next_text(line, "error")["message"]
            assert not any(next_text(line, "robot")["is_switched_on"] for _ in range(5))
        for headers, may_steer in (({}, True), ({"X-Forwarded-For": "192.0.2.99"}, False)):
            with visit(live, "127.0.0.1", **headers) as line:
                assert next_text(line, "welcome")["may_steer"] is may_steer
        with visit(live, address, **{"X-Forwarded-For": "127.0.0.1"}) as line:
            assert next_text(line, "welcome")["may_steer"] is False


def test_a_page_that_disconnects_with_the_dead_man_held_stops_the_robot(setup, quick_uri):
    with serve(setup, quick_uri, "--token", TOKEN) as live:
        with visit(live, "127.0.0.1") as line:
            ask(line, type="take_controls")
            ask(line, type="switch_robot", on=True)
            while not next_text(line, "robot")["is_switched_on"]:
                pass
        with visit(live, "127.0.0.1") as line:
            while (message := next_text(line, "robot"))["is_switched_on"]:
                pass
            assert not message["is_moving"] and "the enable switch is off" in message["reasons"]


# --- refusals at the command line


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--steer",), "--steer needs --robot ROBOT and --robot-setup robot.toml"),
        (("--home",), "--home and --allow-remote-motion go with --steer"),
        (("--steer", "--robot", "crtk:PSM1"), "--steer needs --robot ROBOT and --robot-setup robot.toml"),
    ],
)
def test_a_robot_that_cannot_be_steered_is_refused(arguments, problem):
    result = call("live", "--no-browser", *arguments)
    assert result.exit_code == 2 and problem in result.output


def test_a_robot_that_was_not_checked_is_refused(setup):
    result = call("live", "--no-browser", "--steer", "--robot", "crtk:PSM1", "--robot-setup", setup)
    assert (
        result.exit_code == 2
        and "crtk:PSM1 has not been checked; run haptigraph robot check" in result.output
    )
