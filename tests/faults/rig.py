"""A real run in a process of its own, and an ear at the far end of its device."""

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

from haptigraph.recording.reader import RunReader
from haptigraph.sources.phantom import PhantomSource

HERE = Path(__file__).parent
STEADY = str(HERE.parent / "data" / "steady.toml")
PATIENCE_S = 60.0
DEADMAN_MS = 150
# What a device may add to the dead-man's time: its longest wait for an answer, its least distance between
# commands, or a buffer and a ramp; and 50 ms. How late the machine itself woke others meanwhile is added.
PERIOD_MS = {"serial": 100 + 50, "gamepad": 50 + 50, "audio": 15 + 50, "ros2": 50 + 50}


class Beat(threading.Thread):
    """Wake every 5 ms and note how late: what a busy machine adds to everybody's time.

    Attributes:
        late: (stamp_ns, late_ns) of every wake.
    """

    PERIOD_S = 0.005

    def __init__(self):
        super().__init__(daemon=True)
        self.late, self.over = [], threading.Event()
        self.start()

    def run(self):
        before_ns = time.monotonic_ns()
        while not self.over.wait(self.PERIOD_S):
            now_ns = time.monotonic_ns()
            self.late.append((now_ns, now_ns - before_ns - round(self.PERIOD_S * 1e9)))
            before_ns = now_ns

    def late_ms(self, since_ns, until_ns):
        """Return by how much it was late in all between two moments."""
        return sum(late_ns for stamp_ns, late_ns in self.late if since_ns <= stamp_ns <= until_ns) / 1e6


class Ear:
    """Hear when a device vibrates; `edges` holds (stamp_ns, level) of every change."""

    def __init__(self):
        self.edges, self.changed = [], threading.Condition()

    def note(self, stamp_ns, level):
        with self.changed:
            self.edges.append((stamp_ns, level))
            self.changed.notify_all()

    def until(self, vibrates):
        """Wait until the device vibrates or is silent; return since when [ns]."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.vibrates == vibrates, PATIENCE_S), self.edges[-5:]
            since_ns = 0
            for stamp_ns, level in reversed(self.edges):
                if bool(level) != vibrates:
                    break
                since_ns = stamp_ns
            return since_ns

    def until_silent_once(self, after_ns):
        """Wait for the first silence after a moment, however short; return when it began [ns]."""
        with self.changed:
            silences = lambda: (at_ns for at_ns, level in self.edges if at_ns >= after_ns and not level)  # noqa: E731
            assert self.changed.wait_for(lambda: any(silences()), PATIENCE_S), self.edges[-5:]
            return next(silences())

    @property
    def vibrates(self):
        return bool(self.edges and self.edges[-1][1])


class PipeEar(Ear):
    """Hears through a named pipe what a simulated controller or sound card writes.

    Args:
        path: Of the pipe.
        starves_ms: A sound card that is handed no samples for so long is silent.
    """

    def __init__(self, path, starves_ms=None):
        super().__init__()
        self.starves_s = None if starves_ms is None else starves_ms / 1e3
        os.mkfifo(path)
        self.pipe = os.open(path, os.O_RDWR)  # both ways, so that no writer ends it
        self.thread = threading.Thread(target=self.hear, daemon=True)
        self.thread.start()
        self.path = path

    def hear(self):
        text = ""
        while text != "end":
            if select.select([self.pipe], [], [], self.starves_s)[0]:
                *lines, text = (text + os.read(self.pipe, 4096).decode()).split("\n")
                for stamp_ns, *levels in map(str.split, lines):
                    self.hear_level(int(stamp_ns), max(map(float, levels)))
            else:
                self.hear_level(time.monotonic_ns(), 0.0)

    def hear_level(self, stamp_ns, level):
        if not self.edges or level != self.edges[-1][1]:
            self.note(stamp_ns, level)

    def close(self):
        with open(self.path, "a") as pipe:
            pipe.write("end")
        self.thread.join(PATIENCE_S)
        os.close(self.pipe)


class BoardEar(Ear):
    """Hears a board's pin 9."""

    def __init__(self, link):
        super().__init__()
        self.board = Board(link, heard=lambda stamp_ns, pin, value: self.note(stamp_ns, value))

    def close(self):
        self.board.close()


class RosEar(Ear):
    """Hears what a subscriber on the network does."""

    def __init__(self):
        from haptigraph.ros2.node import Node
        from haptigraph.ros2.types import JoyFeedback

        super().__init__()
        self.node, self.refused = Node(), []
        self.node.subscribe("/joy/set_feedback", JoyFeedback, self.hear, self.refused.append)

    def hear(self, message):
        self.note(time.monotonic_ns(), message.intensity)

    def close(self):
        self.node.close()


def ear_of(device, folder):
    if device == "ros2":
        return RosEar()
    if device == "serial":
        return BoardEar(folder / "tty")
    return PipeEar(folder / "felt", 30 if device == "audio" else None)


class Rig:
    """`haptigraph run camera:0` with one device, recorded, faults on demand.

    Args:
        folder: For everything that is written.
        device: serial, gamepad, audio or ros2.
        arguments: Further ones.
    """

    def __init__(self, folder, device, *arguments, command="run", **options):
        self.device, self.record = device, folder / "run.mcap"
        self.stack = ExitStack()
        self.ear = ear_of(device, folder)
        self.stack.callback(self.ear.close)
        self.beat = Beat()
        self.stack.callback(self.beat.over.set)
        registration = folder / "registration.toml"
        registration.write_text(PhantomSource(STEADY).registration)
        uri = f"serial:{folder / 'tty'}" if device == "serial" else device
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "faulty.py"), STEADY, command, "camera:0", "--device", uri,
             "--registration", str(registration), "--record", str(self.record), *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                 "HAPTIGRAPH_TEST_FELT": str(folder / "felt")},
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

    def until_felt(self):
        """Wait until the hand feels something."""
        try:
            self.ear.until(vibrates=True)
        except AssertionError as error:
            said = "".join(self.lines)
            raise AssertionError(
                f"nothing is felt, exit code {self.process.poll()}: {error}\n{said}"
            ) from None

    def until_recorded(self):
        """Wait until some steps are on disk."""
        give_up_ns = time.monotonic_ns() + round(PATIENCE_S * 1e9)
        while not (self.record.exists() and RunReader(self.record).count()[0]):
            assert time.monotonic_ns() < give_up_ns, "nothing is recorded"
            self.beat.over.wait(0.1)

    def until_told(self, pattern):
        """Wait until it says something; return the match."""
        with self.changed:
            found = lambda: re.search(pattern, "".join(self.lines), re.MULTILINE)  # noqa: E731
            assert self.changed.wait_for(found, PATIENCE_S), "".join(self.lines)
            return found()

    def begin(self, fault):
        """Let a fault begin, and forget what was told before; return when it did [ns]."""
        self.process.stdin.write(f"{fault}\n")
        match = self.until_told(rf"fault {fault} begins (\d+).*\n")
        with self.changed:
            self.lines[:] = ["".join(self.lines)[match.end() :]]
        return int(match[1])

    def signal(self, number):
        """Send a signal; return when [ns]."""
        now_ns = time.monotonic_ns()
        self.process.send_signal(number)
        return now_ns

    def stilled_in_time(self, row, since_ns):
        """Check that the hand is silent in time, and stays so, and keep the figure."""
        self.in_time(row, since_ns, self.ear.until(vibrates=False), DEADMAN_MS + PERIOD_MS[self.device])

    def in_time(self, row, since_ns, still_ns, promised_ms):
        """Check that a silence came in time, and keep the figure."""
        late_ms = (still_ns - since_ns) / 1e6
        path = os.environ.get("HAPTIGRAPH_FAULTS")
        if path:
            with open(path, "a") as file:
                file.write(json.dumps([row, self.device, round(late_ms, 1)]) + "\n")
        machine_ms = self.beat.late_ms(since_ns, still_ns)
        assert late_ms <= promised_ms + machine_ms, (row, late_ms, machine_ms, self.ear.edges[-6:])

    def finish(self):
        """Wait for the end; return exit code, output, and all that it said."""
        try:
            code = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise AssertionError("it does not end: " + "".join(self.lines)) from None
        self.reader.join(PATIENCE_S)
        out = "" if self.process.stdout.closed else self.process.stdout.read()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
        return code, out, "".join(self.lines)
