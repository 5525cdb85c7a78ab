"""Faults of the processes that move a robot, judged by the commands that reach it."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import msgspec
from fault_rig import SHARED_MS, LatencyProbe, environment
from trials import Measured, promise

from haptigraph.robot.check_report import CheckReport, report_path
from haptigraph.version import __version__

PROGRAM = Path(__file__).with_name("steered_robot.py")
SETUP = Path(__file__).parents[2] / "examples" / "robot.toml"
HELD_MS, REPORTED_MS = 50, 500
WAIT_S = 30.0
MOVING_MM = 1e-6
ENDS = {"SIGKILL": "has ended", "SIGTERM": "has ended", "SIGSTOP": "does not respond"}
RESTARTS_S = 0.4


class Steered:
    """A program that steers a robot in a process of its own; both real."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / "commands"
        setup = folder / "robot.toml"
        setup.write_bytes(SETUP.read_bytes())
        uri = f"traced:{self.log}"
        report_path(setup).write_bytes(msgspec.json.encode(CheckReport(uri, True, "now", __version__)))
        self.parent = subprocess.Popen(
            [sys.executable, str(PROGRAM), "steer", uri, str(setup)],
            stdout=subprocess.PIPE, text=True, env=environment(),
        )  # fmt: skip
        self.lines: list[tuple[int, str]] = []
        self._read = threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()
        self.probe = LatencyProbe()

    def __enter__(self) -> "Steered":
        return self

    def __exit__(self, *error: object) -> None:
        self.probe.is_stopped.set()
        for kill in (self.parent.kill, lambda: os.kill(self.child, signal.SIGKILL)):
            with suppress(ProcessLookupError, IndexError):
                kill()
        self.parent.wait(WAIT_S)

    def _listen(self) -> None:
        assert self.parent.stdout is not None
        with self.parent.stdout as lines:
            for line in lines:
                with self._read:
                    self.lines.append((time.monotonic_ns(), line))
                    self._read.notify_all()

    @property
    def child(self) -> int:
        return int(self.lines[-1][1].split()[0])

    def until_said(self, text: str, after_ns: int = 0) -> int:
        """Wait until the program says something; return when."""

        def said() -> int | None:
            return next((at_ns for at_ns, line in self.lines if at_ns >= after_ns and text in line), None)

        with self._read:
            promise(self._read.wait_for(said, WAIT_S), f"{text!r} is not said: {self.lines[-3:]}")
            return said() or 0

    def commands(self) -> list[tuple[int, list[str]]]:
        lines = (line.split() for line in self.log.read_text().splitlines())
        return [(int(line[0]), line[1:]) for line in lines]

    def moving(self) -> list[int]:
        """Return when commands moved the robot."""
        moves = [
            (stamp_ns, tuple(map(float, at))) for stamp_ns, (kind, *at) in self.commands() if kind == "move"
        ]
        return [now_ns for (_, before), (now_ns, at) in pairwise(moves)
                if max(abs(a - b) for a, b in zip(before, at, strict=True)) > MOVING_MM]  # fmt: skip


def is_alive(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def robot_processes(rng: random.Random, folder: Path) -> Measured:
    """The steering program or the robot's process is killed or stopped while it moves the robot."""
    who, how = rng.choice(("program", "process")), rng.choice(tuple(ENDS))
    what = f"{how} of the {'steering program' if who == 'program' else 'robot process'}"
    with Steered(folder) as steered:
        steered.until_said("moving")
        time.sleep(rng.uniform(0.1, 0.8))
        child = steered.child
        target = steered.parent.pid if who == "program" else child
        began_ns = time.monotonic_ns()
        os.kill(target, getattr(signal, how))
        if who == "process":
            said_ns = steered.until_said(ENDS[how], began_ns)
            late_ms = (said_ns - began_ns) / 1e6 - steered.probe.late_ms(began_ns, said_ns) - SHARED_MS
            promise(late_ms <= REPORTED_MS, f"{what}: reported after {late_ms:.0f} ms")
        time.sleep(RESTARTS_S)
        moved = steered.moving()
        if how == "SIGSTOP":
            os.kill(target, signal.SIGCONT)
            time.sleep(RESTARTS_S)
            promise(is_alive(child), f"{what}: the robot's process is gone")
            promise(steered.moving() == moved, f"{what}: motion restarts by itself")
        else:
            give_up_s = time.monotonic() + WAIT_S
            while is_alive(child) and time.monotonic() < give_up_s:
                time.sleep(0.01)
            promise(not is_alive(child), f"{what}: the robot's process is left behind")
            is_killed = who == "process" and how == "SIGKILL"
            promise(is_killed or steered.commands()[-1][1] == ["close"], f"{what}: the robot is not closed")
        promise(moved and moved[0] < began_ns, f"{what}: it did not move before")
        held_ms = (moved[-1] - began_ns) / 1e6
        busy_ms = steered.probe.late_ms(began_ns, max(moved[-1], began_ns)) + SHARED_MS
        promise(held_ms <= HELD_MS + busy_ms, f"{what}: held after {held_ms:.0f} ms (busy {busy_ms:.0f} ms)")
        return Measured(what, round(max(held_ms, 0.0), 1))
