"""Faults drawn at random, as in `trials`: what comes over a network, from a browser, and from files."""

import http.client
import os
import random
import socket
import subprocess
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from damages import GENERAL_DAMAGES
from fault_rig import environment
from live_bench import CHROMIUM, Live, chromium
from ros_network import loopback, tag
from slow_connection import SlowConnection
from trials import DATA, Measured, damaged, program, promise

HERE = Path(__file__).parent
IMAGES = 60
STARTED: list[Any] = []  # the browser that all trials share


class Skipped(Exception):
    """What a trial needs is not installed."""


# --- late news ------------------------------------------------------------------------------------------


@cache
def browser() -> Any:
    if CHROMIUM is None:
        raise Skipped("Chromium is not installed")
    STARTED.append(chromium())
    return STARTED[0].__enter__()


@cache
def vibrating() -> Live:
    return Live(f"phantom:{DATA / 'steady.toml'}")


def end() -> None:
    """End what trials share."""
    if vibrating.cache_info().currsize:
        vibrating().__exit__()
    if STARTED:
        STARTED.pop().__exit__(None, None, None)


def slow_connection(rng: random.Random, folder: Path) -> Measured:
    """The page's connection is slow: what is late is not felt, and the page says so."""
    from live_bench import PAD

    delay_s = rng.uniform(0.16, 1.0)
    url = vibrating().url
    port = int(url.split(":")[2].split("/")[0])
    with SlowConnection(port, delay_s) as slow:
        page = browser().new_page()
        page.add_init_script(PAD)
        page.goto(url.replace(str(port), str(slow), 1))
        page.wait_for_selector("#banner:has-text('Connection too slow')", timeout=60_000)
        page.wait_for_timeout(rng.uniform(200, 1500))
        felt = page.evaluate("window.rumble.filter((call) => call.type === 'dual-rumble').length")
        page.close()
    promise(felt == 0, f"{delay_s:.2f} s each way: {felt} late effects were felt")
    return Measured(f"{delay_s:.2f} s each way")


# --- ROS 2 ----------------------------------------------------------------------------------------------


def raw_images(rng: random.Random, folder: Path) -> Measured:
    """Raw images over ROS 2 arrive: at most one of a trial's is lost."""
    from haptigraph.clock import MonotonicClock
    from haptigraph.errors import MissingExtra, SourceLost

    os.environ.update(network())
    try:
        from haptigraph.ros2.node import buffer_hint
        from haptigraph.sources.cameras.ros2 import Ros2Source
    except (ImportError, MissingExtra):
        raise Skipped("cyclonedds is not installed") from None
    if buffer_hint():
        raise Skipped(buffer_hint())
    size_px = rng.choice(((640, 480), (1280, 720), (1920, 1080)))
    reliability = rng.choice(("reliable", "best effort"))
    source = Ros2Source("/camera/image_raw", size_px=size_px, rate_hz=30.0, clock=MonotonicClock())
    command = [sys.executable, str(HERE / "raw_publisher.py"), *map(str, size_px), reliability, str(IMAGES)]
    last = -1
    with subprocess.Popen(command, env=environment()) as publisher:
        while publisher.poll() is None:
            with suppress(SourceLost):
                if (capture := source.read(0.1)) is not None:
                    last = capture.index
    source.close()
    lost = IMAGES - last - 1
    what = "raw {} x {} px, {}".format(*size_px, reliability)
    promise(lost <= 1, f"{what}: {lost} of {IMAGES} lost")
    return Measured(what, lost=lost)


@cache
def network() -> dict[str, str]:
    return loopback(tag())


# --- files and requests ---------------------------------------------------------------------------------


def damaged_file(rng: random.Random, folder: Path, files: Path) -> Measured:
    """A damaged file of any kind is refused in one sentence, or still valid."""
    kind = rng.choice(("registration", "procedure", "scenario", "protocol", "dicom", "header", "export"))
    if kind == "dicom":
        (folder / "x.dcm").write_bytes(rng.randbytes(128) + b"DICM" + rng.randbytes(rng.randint(0, 3000)))
        done = program("run", folder / "x.dcm", "--fast")
    elif kind == "header":
        data = bytearray((files / "journal.mcap").read_bytes())
        end = data.index(b"haptigraph.Capture")
        for _ in range(rng.randint(1, 20)):
            data[rng.randrange(8, end)] = rng.randrange(256)
        (folder / "x.mcap").write_bytes(data)
        done = program(rng.choice(("replay", "recover")), folder / "x.mcap")
    elif kind == "export":
        target = folder / "export"
        target.mkdir()
        for file in (files / "export").iterdir():
            (target / file.name).write_bytes(file.read_bytes())
        victim = rng.choice(sorted(target.iterdir()))
        rng.choice(GENERAL_DAMAGES)(data := bytearray(victim.read_bytes() or b" "), rng)
        changed = bytes(data) != victim.read_bytes()
        victim.write_bytes(data)
        done = program("study", "import", target, "--store", folder / "new.db")
        promise(done.returncode or not changed, f"a changed {victim.name} was imported")
    else:
        file, command = {
            "registration": (files / "registration.toml", ("check",)),
            "procedure": (files / "procedure.toml", ("check",)),
            "scenario": (DATA / "quick.toml", ("run", "--fast")),
            "protocol": (files / "study.toml", ("study", "check")),
        }[kind]
        path = folder / file.name
        damaged(rng, file, path)
        if kind == "scenario":
            done = program("run", f"phantom:{path}", "--fast", "--set", "source.jpeg_quality=0")
        else:
            done = program(*command, folder if kind == "protocol" else path)
    promise(done.returncode in (0, 1, 2), f"{kind}: exit code {done.returncode}")
    return Measured(f"{kind}, exit code {done.returncode}")


def foreign_requests(rng: random.Random, folder: Path) -> Measured:
    """Requests of other sites, to wrong hosts, or interrupted: refused, and nothing else happens."""
    with Live(f"phantom:{DATA / 'quick.toml'}", "--recordings", folder) as live:
        host = live.url.removeprefix("http://").partition("/")[0]
        for _ in range(20):
            headers = {}
            if rng.random() < 0.5:
                headers["Host"] = rng.choice(
                    ("evil.example", f"{host}, evil", "", f"{host} evil", "127.0.0.1:x")
                )
            else:
                headers["Sec-Fetch-Site"] = rng.choice(("cross-site", "same-site"))
            path = rng.choice(("/recordings/list", "/recordings/compare?run=a", "/registration/start"))
            connection = http.client.HTTPConnection(host, timeout=10)
            connection.request("GET", path, headers=headers)
            promise(connection.getresponse().status == 403, f"{path} with {headers} was served")
            connection.close()
            with socket.create_connection(tuple(host.split(":")), timeout=10) as line:
                body = f"POST /registration/open HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
                line.sendall(f"{body}Content-Length: {rng.randint(5, 9999)}\r\n\r\n{{".encode())
        time.sleep(0.1)
        output = live.stop()
    promise("Traceback" not in output and "Exception" not in output, f"a traceback: {output[-300:]}")
    promise(live.process.returncode == 0, f"exit code {live.process.returncode}")
    return Measured("20 requests")
