"""The server from outside: access control, invalid messages, bad arguments, shutdown."""

import json
import random
import signal
import socket
import string

import pytest
from helpers import call, refuse, scenario_at
from live_bench import Live
from visiting import address, get, next_image, next_text, watching
from websockets.exceptions import ConnectionClosed, InvalidStatus

BURST = 50


def test_pages_are_served_with_security_headers(live):
    status, text, headers = get(live)
    assert status == 200
    assert "<nav aria-label" in text
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy and "script-src 'self'" in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert get(live, "/static/live/live.js")[2]["Content-Type"].startswith("text/javascript")


@pytest.mark.parametrize(
    "path",
    [
        "/static/common/../../server/server.py",
        "/static/common/%2e%2e%2fserver.py",
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/common/none.js",
        "/static/none.js",
        "/x",
    ],
)
def test_only_static_files_are_served(live, path):
    status, text, _ = get(live, path)
    assert status == 404 and text.startswith("haptigraph: ") and text.count("\n") == 1


def test_requests_for_another_host_are_refused(live):
    status, text, _ = get(live, Host="evil.example:80")
    assert status == 403
    assert text == "haptigraph: this server answers requests for 127.0.0.1 only, not for evil.example\n"


@pytest.mark.parametrize("host", ["127.0.0.1:8201, evil.example", "127.0.0.1 evil", "127.0.0.1:80:80", ""])
def test_a_host_must_be_one_name(live, host):
    status, text, _ = get(live, Host=host)
    assert status == 403
    assert text == "haptigraph: the Host header is not one host name with or without port\n"


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_sites_may_link_to_pages_but_not_start_work(live, site):
    for path in ("/recordings/compare?run=a.mcap", "/recordings/list", "/registration/start"):
        status, text, _ = get(live, path, Sec_Fetch_Site=site)
        assert (status, text) == (403, "haptigraph: requests from pages of other sites are not permitted\n")
    assert get(live, "/recordings", Sec_Fetch_Site=site)[0] == 200
    assert get(live, "/recordings/list", Sec_Fetch_Site="same-origin")[0] == 200


def test_sockets_of_other_origins_are_refused(live):
    for origin in ("http://evil.example", "null", None):
        with pytest.raises(InvalidStatus) as refused, watching(live, origin=origin):
            pass
        assert refused.value.response.status_code == 403


def test_posts_of_other_origins_are_refused(live):
    assert get(live, method="POST", Origin="http://evil.example")[0] == 403
    assert get(live, method="POST")[0] == 403


@pytest.fixture(scope="module")
def guarded(calm_uri):
    with Live(calm_uri, "--host", "0.0.0.0", "--token", "open sesame") as running:
        yield running


def test_other_hosts_need_the_token(guarded):
    assert guarded.url.endswith("/?token=open%20sesame")
    for path in ("/", "/static/live/live.js", "/?token=wrong"):
        status, text, _ = get(guarded, path)
        assert status == 403
        what = "wrong" if "wrong" in path else "no"
        assert text == f"haptigraph: {what} token; open the address that haptigraph printed\n"
    with pytest.raises(InvalidStatus), watching(guarded):
        pass


def test_the_token_moves_into_a_cookie(guarded):
    status, _, headers = get(guarded, "/?token=open%20sesame")
    assert (status, headers["Location"]) == (303, "/")
    assert "HttpOnly" in headers["Set-Cookie"] and "strict" in headers["Set-Cookie"].lower()
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert get(guarded, Cookie=cookie)[0] == 200
    with watching(guarded, additional_headers={"Cookie": cookie}) as line:
        assert next_text(line, "hello")["procedure"]["name"] == "subretinal_injection"


def test_a_token_is_generated_if_none_is_given(calm_uri):
    with Live(calm_uri, "--host", "0.0.0.0") as live:
        assert len(live.url.partition("?token=")[2]) >= 16


def test_messages_have_the_documented_fields(live, procedure):
    with watching(live) as line:
        assert next_text(line, "welcome")["name"].startswith("page ")
        hello = next_text(line, "hello")
        assert [state["name"] for state in hello["procedure"]["states"]] == [s.name for s in procedure.states]
        assert {state["name"]: state["icon"] for state in hello["procedure"]["states"]} == {
            "unknown": "lost",
            "tip_not_visible": "tipless",
            "retinal_contact": "alarm",
            "target_hit": "done",
            "misaligned_retinal_approach": "warn",
            "aligned_retinal_approach": "calm",
            "misaligned_intraocular_navigation": "warn",
            "aligned_intraocular_navigation": "calm",
            "outside_eye": "idle",
        }
        assert {state["name"]: state["column"] for state in hello["procedure"]["states"]}[
            "target_hit"
        ] == "middle"
        header, picture = next_image(line)
        assert header["has_picture"] and picture[:2] == b"\xff\xd8"
        line.send(json.dumps({"type": "ping", "time_ms": 12.5}))
        pong = next_text(line, "pong")
        assert pong["time_ms"] == 12.5
        assert pong["now_ms"] >= header["time_ms"]


def test_without_acknowledgement_two_images_are_sent(live):
    with watching(live) as lazy, watching(live) as eager:
        seen = 0
        while seen < 20:
            next_image(eager)
            seen += 1
        images = 0
        while True:
            try:
                images += isinstance(lazy.recv(timeout=0), bytes)
            except TimeoutError:
                break
        assert images == 2


def test_a_late_viewer_learns_who_has_the_controls(quick, tmp_path):
    with Live(f"teleop:{scenario_at(30, quick, tmp_path)}") as live, watching(live) as first:
        first.send('{"type": "take_controls"}')
        name = next_text(first, "welcome")["name"]
        while next_text(first, "controls")["holder"] != name:
            pass
        with watching(live) as second:
            assert next_text(second, "controls")["holder"] == name
            assert next_text(second, "settings")["tremor_filter"] is False
            second.send('{"type": "take_controls"}')  # ignored
            first.send('{"type": "release_controls"}')
            assert next_text(second, "controls")["holder"] == ""


def invalid_message(chance):
    """Return text or bytes that are not a valid message."""
    valid = [
        {"type": "ack", "number": 3},
        {"type": "motion", "hand": {"engaged": True, "along_mm": 1.0, "across_mm": 0.0, "apart_mm": 0.1}},
        {"type": "tune", "motion_scale": 0.2, "tremor_filter": True},
        {"type": "ping", "time_ms": 1.0},
        {"type": "watch", "images": True},
    ]
    text = json.dumps(chance.choice(valid))
    bad = [-1, 1e300, "x", None, [], {}, [[]] * 5, "é" * 1000, 2**70]
    kind = chance.randrange(8)
    if kind == 0:
        return bytes(chance.randrange(256) for _ in range(chance.randrange(200)))
    if kind == 1:
        return "".join(chance.choices(string.printable + "äöü漢字\u0000", k=chance.randrange(300)))
    if kind == 2:
        return text[: chance.randrange(len(text) - 1)]
    if kind == 3:
        content = chance.choice(valid)
        return json.dumps({**content, chance.choice(["extra", "type"]): chance.choice(bad)})
    if kind == 4:
        return json.dumps({"type": chance.choice(["take_controls!", "hello", "", "image", 7, None])})
    if kind == 5:
        return chance.choice(["[", '{"type":', '{"a":[']) * chance.randrange(1, 8000)
    if kind == 6:
        return chance.choice(
            ['{"type":"ping","time_ms":NaN}', '{"type":"ping","time_ms":1e999}', "null", "[]", "7"]
        )
    hand = {
        "engaged": chance.choice([1, "yes"]),
        "along_mm": chance.choice(bad),
        "across_mm": chance.choice(bad),
        "apart_mm": chance.choice(bad),
    }
    return json.dumps({"type": "motion", "hand": hand})


@pytest.mark.parametrize("count", [2_000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_invalid_messages_are_answered_and_disturb_no_other_viewer(quick_uri, count):
    chance = random.Random(4)
    with Live(quick_uri) as live, watching(live) as clean, watching(live) as fuzzed:
        before, _ = next_image(clean)
        for _ in range(count // BURST):
            for _ in range(BURST):
                fuzzed.send(invalid_message(chance))
            for _ in range(BURST):
                assert next_text(fuzzed, "error")["message"].startswith("invalid message: ")
            after, _ = next_image(clean)
        assert after["index"] > before["index"]
        health = next_text(clean, "health")
        assert health["dropped"] == 0
        assert set(health["faults"]) <= {"source"}  # on a loaded machine an image may be late
        output = live.stop()
    assert live.process.returncode == 0
    assert "Traceback" not in output and "interrupted" in output


def test_an_oversized_message_closes_only_its_own_connection(live):
    with watching(live) as clean, watching(live) as greedy:
        with pytest.raises(ConnectionClosed):
            greedy.send("x" * 1_000_000)  # the server may close the connection before it has all of it
            while True:
                greedy.recv(timeout=10)
        next_image(clean)


def test_other_protocols_on_the_port_disturb_nothing(live):
    host, _, port = address(live).partition(":")
    with watching(live) as clean:
        for data in (
            b"\x00\xff" * 100,
            b"GET / HTTP/1.1\r\n\r\n",
            b"GET /live HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
        ):
            with socket.create_connection((host, int(port)), timeout=10) as client:
                client.sendall(data)
                client.recv(1000)
        next_image(clean)


def test_bad_arguments_are_refused(quick_uri, live):
    port = live.url.rpartition(":")[2].strip("/")
    for arguments, sentence in (
        (("nowhere.mp4",), "haptigraph: nowhere.mp4: file not found"),
        (
            (quick_uri, "--port", port),
            f"haptigraph: cannot listen on 127.0.0.1, port {port} (Address already in use)",
        ),
        (
            (quick_uri, "--host", "no.such.host.invalid"),
            "'no.such.host.invalid' is not an address of this machine",
        ),
        ((quick_uri, "--host", "192.0.2.7"), "cannot listen on 192.0.2.7"),
        ((quick_uri, "--device", "hammer"), "unknown device 'hammer'"),
        ((quick_uri, "--procedure", "dance"), "unknown procedure 'dance'"),
    ):
        assert sentence in refuse("live", *arguments)
    assert call("live", quick_uri, "--port", "70000").exit_code == 2


@pytest.mark.parametrize(
    "ending", [signal.SIGINT, signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)]
)
def test_a_signal_ends_loop_and_server_with_viewers(quick_uri, tmp_path, ending):
    from haptigraph.recording.reader import RunReader

    record, trace = tmp_path / "run.mcap", tmp_path / "touch.csv"
    with Live(quick_uri, "--record", record, "--device", f"trace:{trace}") as live, watching(live) as line:
        header, _ = next_image(line)
        while header["state"] != "misaligned_intraocular_navigation":
            header, _ = next_image(line)
        live.process.send_signal(ending)
        assert next_text(line, "ended")["reason"] == "interrupted"
        out, err = live.process.communicate(timeout=30)
    assert live.process.returncode == 0
    assert "interrupted" in out and "Traceback" not in err
    assert RunReader(record).is_whole
    assert trace.read_text().splitlines()[-1].split(",")[1] == "0.0"


def test_the_page_outlasts_a_file_and_reports_its_end(quick_uri, tmp_path):
    record = tmp_path / "run.mcap"
    assert call("run", quick_uri, "--fast", "--record", record).exit_code == 0
    with Live(record) as live, watching(live) as line:
        assert next_text(line, "ended")["reason"] == "source ended"
        with watching(live) as later:
            assert next_text(later, "ended")["reason"] == "source ended"
        output = live.stop()
    assert live.process.returncode == 0
    assert "the page stays until Ctrl-C" in output
    assert "target hit after" in output


def test_ctrl_c_at_the_end_of_a_file_is_no_failure(quick_uri, tmp_path, monkeypatch):
    from haptigraph.dashboard.live.live import LivePage

    record = tmp_path / "run.mcap"
    assert call("run", quick_uri, "--fast", "--record", record).exit_code == 0
    end = LivePage.end

    def end_with_signal(self, reason):
        end(self, reason)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(LivePage, "end", end_with_signal)
    result = call("live", record)
    assert result.exit_code == 0
    assert "target hit after" in result.stdout
