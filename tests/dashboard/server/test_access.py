"""Who may do what: the address to steer, and the one to watch, which never steers."""

import json
import re

import pytest
from live_bench import Live
from visiting import get, next_image, next_text, watching
from websockets.exceptions import InvalidStatus

WATCH, STEER = "just look", "open sesame"


@pytest.fixture(scope="module")
def steerable():
    """A server on all addresses, whose needle can be steered."""
    with Live("teleop", "--host", "0.0.0.0", "--token", STEER) as live:
        while "watch" not in live.lines[-1]:
            live.lines.append(live.process.stderr.readline())
        yield live


@pytest.fixture(scope="module")
def cookies(steerable):
    """The cookies of a visitor that steers, and of one that watches, from the printed addresses."""

    def cookie(line: str) -> str:
        _, headers = get(steerable, "/" + line.strip().rpartition("/")[2])[1:]
        return headers["Set-Cookie"].partition(";")[0]

    (watch,) = (line for line in steerable.lines if "to watch" in line)
    return cookie(steerable.url), cookie(watch)


def test_the_printed_addresses_can_be_opened_from_another_computer(steerable):
    text = "".join(steerable.lines)
    assert "0.0.0.0" not in text
    assert re.search(r"the page is at http://[\d.]+:\d+/\?token=open%20sesame\n", text)
    assert re.search(r"to watch only: http://[\d.]+:\d+/\?token=[\w-]{16}\n", text)


def test_the_two_addresses_have_different_tokens(cookies):
    assert cookies[0] != cookies[1]


@pytest.mark.parametrize("message", [{"type": "take_controls"}, {"type": "enter_phase", "phase": "x"}])
def test_a_visitor_that_watches_never_steers(steerable, cookies, message):
    with watching(steerable, additional_headers={"Cookie": cookies[1]}) as line:
        assert next_text(line, "welcome")["may_steer"] is False
        assert next_text(line, "controls")["holder"] == ""
        line.send(json.dumps(message))
        line.send(json.dumps({"type": "motion", "hand": {"engaged": True, "along_mm": 3}}))
        assert next_text(line, "error")["message"] == "this page watches only; it cannot steer"
        before = next_image(line)[0]["found"]
        line.send(json.dumps({"type": "ping", "time_ms": 1}))
        assert next_text(line, "pong")["time_ms"] == 1
        assert next_image(line)[0]["found"].keys() == before.keys()
    with watching(steerable, additional_headers={"Cookie": cookies[0]}) as line:
        assert next_text(line, "welcome")["may_steer"] is True
        line.send(json.dumps({"type": "take_controls"}))
        while next_text(line, "controls")["holder"] == "":
            pass


def test_a_visitor_that_watches_sees_the_live_page_alone(steerable, cookies):
    status, text, _ = get(steerable, Cookie=cookies[1])
    assert status == 200 and 'href="/registration"' not in text
    assert 'href="/registration"' in get(steerable, Cookie=cookies[0])[1]
    assert get(steerable, "/static/live/live.js", Cookie=cookies[1])[0] == 200
    for path in ("/registration", "/registration/start", "/recordings", "/recordings/list"):
        status, text, _ = get(steerable, path, Cookie=cookies[1])
        assert status == 403
        assert (
            text == "haptigraph: this address only watches; open the one to steer that haptigraph printed\n"
        )
        assert get(steerable, path, Cookie=cookies[0])[0] == 200


def test_a_visitor_that_watches_cannot_write(steerable, cookies):
    host = steerable.url.removeprefix("http://").partition("/")[0]
    answer = get(steerable, "/registration/save", "POST", Cookie=cookies[1], Origin=f"http://{host}")
    assert answer[0] == 403 and "only watches" in answer[1]


def test_no_token_still_opens_nothing(steerable):
    assert get(steerable)[0] == 403
    with pytest.raises(InvalidStatus), watching(steerable):
        pass


def test_on_this_machine_alone_everyone_steers(live):
    with watching(live) as line:
        assert next_text(line, "welcome")["may_steer"] is True
    assert "watch" not in "".join(live.lines) and "token" not in live.url
