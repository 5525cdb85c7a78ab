"""Visitors cannot use up connections, descriptors or the log."""

import logging
import socket
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from live_bench import Live
from visiting import address, get, next_image, watching

from haptigraph.dashboard.server.connections import MAX_CONNECTIONS, MAX_KINDS, BoundedLog

HALF_A_HEADER = b"GET / HTTP/1.1\r\nHost: 127.0.0.1"
HALF_A_BODY = (
    b"POST /registration/open HTTP/1.1\r\nHost: %s\r\nOrigin: http://%s\r\nContent-Length: 99\r\n\r\n{"
)


@pytest.fixture
def running(calm_uri):
    with Live(calm_uri) as running:
        yield running


def half_open(live, data):
    host, _, port = address(live).partition(":")
    line = socket.create_connection((host, int(port)), timeout=30)
    line.sendall(data)
    return line


def descriptors(live):
    return len(list(Path(f"/proc/{live.process.pid}/fd").iterdir()))


def test_half_open_connections_take_no_place_of_others(running):
    before = descriptors(running)
    with watching(running) as viewer, ExitStack() as stack:
        for _ in range(10 * MAX_CONNECTIONS):
            stack.enter_context(half_open(running, HALF_A_HEADER))
        assert get(running)[0] == 200
        assert descriptors(running) <= before + MAX_CONNECTIONS + 10
        next_image(viewer)
    output = running.stop()
    assert running.process.returncode == 0
    assert "Traceback" not in output
    assert len(output) < 5_000


def test_a_request_that_is_never_completed_is_ended(running):
    body = HALF_A_BODY.replace(b"%s", address(running).encode())
    with ExitStack() as stack:
        lines = [stack.enter_context(half_open(running, data)) for data in (b"", HALF_A_HEADER, body)]
        for line in lines:
            with suppress(ConnectionResetError):
                assert line.recv(1000) == b""
    output = running.stop()
    assert "Traceback" not in output and "Exception" not in output


def test_an_interrupted_post_is_no_error_of_the_server(running):
    for _ in range(5):
        half_open(running, HALF_A_BODY.replace(b"%s", address(running).encode())).close()
    assert get(running)[0] == 200
    assert "server:" not in running.stop()


def test_the_log_has_one_line_for_each_kind_of_problem(capsys):
    logger = logging.getLogger("uvicorn.error")
    with BoundedLog():
        for _ in range(1000):
            logger.warning("Invalid HTTP request received.")
        for _ in range(3):
            try:
                raise OSError(24, "Too many open files")
            except OSError:
                logger.exception("accept() failed\ndetails")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "haptigraph: server: Invalid HTTP request received."
    assert lines[1].startswith(
        "haptigraph: server: accept() failed: OSError: [Errno 24] Too many open files ("
    )
    assert lines[2] == "haptigraph: server: 1000 x Invalid HTTP request received."
    assert lines[3].startswith("haptigraph: server: 3 x accept() failed: OSError")
    assert len(lines) == 4


def test_the_log_is_bounded_even_if_no_problem_repeats(capsys):
    with BoundedLog():
        for number in range(10 * MAX_KINDS):
            logging.getLogger("asyncio").error("problem %d", number)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == MAX_KINDS + 2
    assert lines[-1] == f"haptigraph: server: {9 * MAX_KINDS} x other problems"
