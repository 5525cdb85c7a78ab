"""A real run in a process of its own, and a monitor of its device's output."""

import json
import os
import re
import select
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

from firmata_board import Board
from haptic_driver import DriverBoard

from haptigraph.recording.reader import RunReader
from haptigraph.sources.phantom import PhantomSource

HERE = Path(__file__).parent
STEADY = str(HERE.parent / "data" / "steady.toml")
TIMEOUT_S = 60.0
DEADMAN_MS = 150
# What a device may add to the dead-man time: its timeout of a response, its minimum interval between commands, or
# a buffer and a ramp; and 50 ms. The scheduling latency of the machine meanwhile is added.
PERIOD_MS = {
    "serial": 100 + 50,
    "drv2605": 100 + 50,
    "gamepad": 50 + 50,
    "audio": 15 + 50,
    "ros2": 50 + 50,
    "crtk": 50 + 50,
}
PASSING = "perceiver fails twice", "interpreter stalls"  # faults after which it soon vibrates by itself
ENABLE_PIN = 7
URI = {  # where it is not the name
    "crtk": "crtk:hand",
    "serial": "serial:{tty}",
    "drv2605": "drv2605:{tty}?motor=lra&mux=0x70&channel=0,1",
}
# The results' file; with it, the machine is expected to have no other work (`make bench-silence`).
RESULTS = os.environ.get("HAPTIGRAPH_FAULTS")
SHARED_MS = 0 if RESULTS else 1000  # what other work on the machine may add to any process


def environment(**more):
    """Return the environment of a child process that imports what this one does."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **more}


class LatencyProbe(threading.Thread):
    """Wake every 5 ms and log the delay: the scheduling latency that a busy machine adds to every thread.

    Attributes:
        late: (stamp_ns, late_ns) of every wake-up.
    """

    PERIOD_S = 0.005

    def __init__(self):
        super().__init__(daemon=True)
        self.late, self.is_stopped = [], threading.Event()
        self.start()

    def run(self):
        before_ns = time.monotonic_ns()
        while not self.is_stopped.wait(self.PERIOD_S):
            now_ns = time.monotonic_ns()
            self.late.append((now_ns, now_ns - before_ns - round(self.PERIOD_S * 1e9)))
            before_ns = now_ns

    def late_ms(self, since_ns, until_ns):
        """Return the total delay between two times."""
        return sum(late_ns for stamp_ns, late_ns in self.late if since_ns <= stamp_ns <= until_ns) / 1e6


class OutputMonitor:
    """Monitor the output of a device; `edges` contains (stamp_ns, level) of every change."""

    def __init__(self):
        self.edges, self.changed = [], threading.Condition()

    def note(self, stamp_ns, level):
        with self.changed:
            self.edges.append((stamp_ns, level))
            self.changed.notify_all()

    def until(self, vibrates):
        """Wait until the device vibrates or is silent; return since when [ns]."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.vibrates == vibrates, TIMEOUT_S), self.edges[-5:]
            since_ns = 0
            for stamp_ns, level in reversed(self.edges):
                if bool(level) != vibrates:
                    break
                since_ns = stamp_ns
            return since_ns

    def until_silent_once(self, after_ns):
        """Wait for the first silence after a time, however short; return when it began [ns]."""
        with self.changed:
            silences = lambda: (at_ns for at_ns, level in self.edges if at_ns >= after_ns and not level)  # noqa: E731
            assert self.changed.wait_for(lambda: any(silences()), TIMEOUT_S), self.edges[-5:]
            return next(silences())

    @property
    def vibrates(self):
        return bool(self.edges and self.edges[-1][1])


class PipeMonitor(OutputMonitor):
    """Read the output of a simulated controller or sound card from a named pipe.

    Args:
        path: Path of the pipe.
        starves_ms: A sound card that receives no samples for this time is silent.
    """

    def __init__(self, path, starves_ms=None):
        super().__init__()
        self.starves_s = None if starves_ms is None else starves_ms / 1e3
        os.mkfifo(path)
        self.pipe = os.open(path, os.O_RDWR)  # for reading and writing, so that it does not end with a writer
        self.thread = threading.Thread(target=self.listen, daemon=True)
        self.thread.start()
        self.path = path

    def listen(self):
        text = ""
        while text != "end":
            if select.select([self.pipe], [], [], self.starves_s)[0]:
                *lines, text = (text + os.read(self.pipe, 4096).decode()).split("\n")
                for stamp_ns, *levels in map(str.split, lines):
                    self.note_level(int(stamp_ns), max(map(float, levels)))
            else:
                self.note_level(time.monotonic_ns(), 0.0)

    def note_level(self, stamp_ns, level):
        if not self.edges or level != self.edges[-1][1]:
            self.note(stamp_ns, level)

    def close(self):
        with open(self.path, "a") as pipe:
            pipe.write("end")
        self.thread.join(TIMEOUT_S)
        os.close(self.pipe)


class BoardMonitor(OutputMonitor):
    """Monitor pin 9 of a simulated board."""

    def __init__(self, link):
        super().__init__()
        self.board = Board(link, on_change=lambda stamp_ns, pin, value: self.note(stamp_ns, value))

    def close(self):
        self.board.close()


class RosMonitor(OutputMonitor):
    """Subscribe to the messages on the network."""

    def __init__(self):
        from haptigraph.ros2.node import Node
        from haptigraph.ros2.types import JoyFeedback

        super().__init__()
        self.node, self.refused = Node(), []
        self.node.subscribe("/joy/set_feedback", JoyFeedback, self.receive, self.refused.append)

    def receive(self, message):
        self.note(time.monotonic_ns(), message.intensity)

    def close(self):
        self.node.close()


class ArmMonitor(RosMonitor):
    """Subscribe to the forces of a leader arm: 1 while it feels one."""

    def __init__(self):
        from haptigraph.ros2.motion_types import WrenchStamped

        super().__init__()
        self.node.subscribe("/hand/servo_cf", WrenchStamped, self.receive_force, self.refused.append)

    def receive_force(self, message):
        self.note(time.monotonic_ns(), float(message.wrench.force.x != 0))


class DriverMonitor(OutputMonitor):
    """Monitor the stronger output of two simulated drivers on a board.

    Args:
        link: The port.
        enable_pin: The pin that their EN is wired to; None: to their power.
    """

    def __init__(self, link, enable_pin):
        super().__init__()
        self.board = DriverBoard(link, (0, 1), enable_pin, felt=self.note)

    def close(self):
        self.board.close()


def monitor_of(device, folder, enable_pin):
    if device == "drv2605":
        return DriverMonitor(folder / "tty", enable_pin)
    if device in ("crtk", "ros2"):
        return ArmMonitor() if device == "crtk" else RosMonitor()
    if device == "serial":
        return BoardMonitor(folder / "tty")
    return PipeMonitor(folder / "output", 30 if device == "audio" else None)


class Rig:
    """`haptigraph run camera:0` with one device and a recording, and faults on demand.

    Args:
        folder: Folder for all files.
        device: serial, drv2605, gamepad, audio, ros2 or crtk.
        arguments: Further arguments of the command.
        enable_pin: The pin that the EN of drivers is wired to; None: to their power.
    """

    def __init__(self, folder, device, *arguments, command="run", enable_pin=None, **options):
        self.device, self.record = device, folder / "run.mcap"
        self.stack = ExitStack()
        self.monitor = monitor_of(device, folder, enable_pin)
        self.stack.callback(self.monitor.close)
        self.probe = LatencyProbe()
        self.stack.callback(self.probe.is_stopped.set)
        registration = folder / "registration.toml"
        registration.write_text(PhantomSource(STEADY).registration)
        uri = URI.get(device, device).format(tty=folder / "tty") + (
            f"&enable={enable_pin}" if enable_pin else ""
        )
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "faulty.py"), STEADY, command, "camera:0", "--device", uri,
             "--registration", str(registration), "--record", str(self.record), *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1,
            env=environment(HAPTIGRAPH_TEST_OUTPUT=str(folder / "output")),
            **options,
        )  # fmt: skip
        self.lines, self.changed = [], threading.Condition()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        with self.stack:
            if self.process.poll() is None:
                self.process.kill()
            self.finish()

    def read(self):
        for line in self.process.stderr:
            with self.changed:
                self.lines.append(line)
                self.changed.notify_all()

    def until_vibrating(self):
        """Wait until the device vibrates."""
        try:
            self.monitor.until(vibrates=True)
        except AssertionError as error:
            output = "".join(self.lines)
            raise AssertionError(
                f"no vibration, exit code {self.process.poll()}: {error}\n{output}"
            ) from None

    def until_recorded(self):
        """Wait until some steps are on disk."""
        give_up_ns = time.monotonic_ns() + round(TIMEOUT_S * 1e9)
        while not (self.record.exists() and RunReader(self.record).count()[0]):
            assert time.monotonic_ns() < give_up_ns, "no step is recorded"
            self.probe.is_stopped.wait(0.1)

    def until_output(self, pattern):
        """Wait until standard error matches a pattern; return the match."""
        with self.changed:
            found = lambda: re.search(pattern, "".join(self.lines), re.MULTILINE)  # noqa: E731
            assert self.changed.wait_for(found, TIMEOUT_S), "".join(self.lines)
            return found()

    def begin(self, fault):
        """Begin a fault and discard earlier output; return when it began [ns]."""
        self.process.stdin.write(f"{fault}\n")
        match = self.until_output(rf"fault {fault} begins (\d+).*\n")
        with self.changed:
            self.lines[:] = ["".join(self.lines)[match.end() :]]
        return int(match[1])

    def watchdog(self):
        """Return the process number of the run's watchdog: the oldest, as others wait in reserve."""
        children = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        numbers = [int(pid) for file in children for pid in file.read_text().split()]
        return min(numbers, key=lambda pid: int(Path(f"/proc/{pid}/stat").read_text().split()[21]))

    def signal(self, number):
        """Send a signal; return when [ns]."""
        now_ns = time.monotonic_ns()
        self.process.send_signal(number)
        return now_ns

    def silent_in_time(self, row, since_ns):
        """Check that the device is silent in time, and stays so unless the fault passes; log the delay."""
        if row in PASSING:
            silent_ns = self.monitor.until_silent_once(since_ns)
        else:
            silent_ns = self.monitor.until(vibrates=False)
        self.in_time(row, since_ns, silent_ns, DEADMAN_MS + PERIOD_MS[self.device])

    def in_time(self, row, since_ns, silent_ns, promised_ms):
        """Check that a silence came in time, and log the delay."""
        late_ms = (silent_ns - since_ns) / 1e6
        if RESULTS:
            with open(RESULTS, "a") as file:
                file.write(json.dumps([row, self.device, round(late_ms, 1)]) + "\n")
        machine_ms = self.probe.late_ms(since_ns, silent_ns)
        assert late_ms <= promised_ms + machine_ms + SHARED_MS, (
            row,
            late_ms,
            machine_ms,
            self.monitor.edges[-6:],
        )

    def finish(self):
        """Wait for the end; return exit code, standard output and standard error."""
        try:
            code = self.process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            raise AssertionError("the run does not end: " + "".join(self.lines)) from None
        self.reader.join(TIMEOUT_S)
        out = "" if self.process.stdout.closed else self.process.stdout.read()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
        return code, out, "".join(self.lines)
