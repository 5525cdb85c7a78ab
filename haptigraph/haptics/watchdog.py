"""Keep a device in a process of its own, which stills it when the run dies, even by kill -9, or hangs.

For actuators that go on until told otherwise. Run as a program this module is that process: it takes orders
from its input, answers each, and stills the device when none came for `HOLDS_MS`, when the input ends, and on
SIGTERM.
Knows no device; which class to open comes from `assemble`.
"""

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib import import_module
from typing import IO

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput, DeviceError, HaptigraphError
from haptigraph.messages import Capabilities
from haptigraph.stages import Device

__all__ = ["Answer", "Order", "Ward", "WatchedDevice", "main"]

HOLDS_MS = 150.0
ANSWER_S = 0.25
START_S = 20.0  # imports, and a board that starts anew
CLOSE_S = 2.0


class Order(Struct, array_like=True):
    """What the device shall do."""

    number: int
    amplitude: float
    frequency_hz: float
    stamp_ns: int


class Answer(Struct, array_like=True):
    """What came of an order; number 0 tells that the device is open."""

    number: int
    error: str = ""
    capabilities: Capabilities | None = None


class WatchedDevice:
    """Pass everything on to a device in a process of its own.

    Args:
        device: "module:Class" of the device.
        argument: What it takes.

    Raises:
        BadInput: If it cannot be opened.
    """

    def __init__(self, device: str, argument: str) -> None:
        self._command = [sys.executable, "-P", "-m", "haptigraph.haptics.watchdog", device, argument]
        self._number = 0
        self._process, self._answers = self._start()
        opened = self._answer(0, START_S)
        if opened is None or opened.capabilities is None:
            self._end()
            raise BadInput(opened.error if opened else f"device {argument} does not open")
        self.capabilities = replace(opened.capabilities, holds_ms=HOLDS_MS)

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Pass on and await the answer."""
        if self._process.poll() is not None:
            self._end()
            self._process, self._answers = self._start()
        self._number += 1
        order = msgspec.json.encode(Order(self._number, amplitude, frequency_hz, stamp_ns))
        stdin = _open_end(self._process.stdin)
        with suppress(BrokenPipeError):
            stdin.write(order + b"\n")
        answer = self._answer(self._number, ANSWER_S)
        if answer is None or answer.error:
            raise DeviceError(answer.error if answer else "the device does not answer")

    def close(self) -> None:
        """Still and release the device, end its process."""
        _open_end(self._process.stdin).close()
        try:
            self._process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._end()
            raise DeviceError("the device does not answer; it may still vibrate") from None

    def _start(self) -> tuple["subprocess.Popen[bytes]", "queue.SimpleQueue[Answer]"]:
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # so that Ctrl-C, or a kill of the run's group, spares it
        )
        answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        end = _open_end(process.stdout)
        threading.Thread(
            target=_read_answers, args=(end, answers), name="haptigraph-warden", daemon=True
        ).start()
        return process, answers

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        _open_end(self._process.stdin).close()

    def _answer(self, number: int, within_s: float) -> Answer | None:
        give_up_s = time.monotonic() + within_s
        with suppress(queue.Empty):
            while True:
                answer = self._answers.get(timeout=max(give_up_s - time.monotonic(), 0))
                if answer.number == number or (answer.number == 0 and answer.error):
                    return answer
        return None


class Ward:
    """The device's side: obey orders, and still the device when they stop.

    Args:
        device: The device.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._orders: queue.SimpleQueue[tuple[float, Order | None]] = queue.SimpleQueue()
        self._vibrates = False

    def serve(self, orders: IO[bytes], answers: IO[bytes]) -> None:
        """Obey until the orders end; the device is still then."""
        threading.Thread(target=self._read, args=(orders,), daemon=True).start()
        try:
            while (order := self._next()) is not None:
                _say(answers, Answer(order.number, self._obey(order)))
        finally:
            with suppress(Exception):
                self._device.close()

    def _next(self) -> Order | None:
        """Return the newest order; none means the end. Still the device while none comes."""
        try:
            came_s, order = self._orders.get(timeout=HOLDS_MS / 1e3 if self._vibrates else None)
            while not self._orders.empty():
                came_s, order = self._orders.get()
        except queue.Empty:
            return Order(-1, 0.0, 0.0, 0)
        if order is not None and time.monotonic() - came_s > HOLDS_MS / 1e3:
            order = replace(order, amplitude=0.0)  # it waited for a device that did not answer
        return order

    def _obey(self, order: Order) -> str:
        self._vibrates = order.amplitude > 0
        try:
            self._device.set(order.amplitude, order.frequency_hz, order.stamp_ns)
        except Exception as error:
            self._vibrates = True  # who knows: so silence is tried again
            return str(error) or type(error).__name__
        return ""

    def _read(self, orders: IO[bytes]) -> None:
        decode = msgspec.json.Decoder(Order).decode
        with suppress(OSError, msgspec.DecodeError):
            while line := orders.readline():
                self._orders.put((time.monotonic(), decode(line)))
        self._orders.put((time.monotonic(), None))


def _read_answers(end: IO[bytes], answers: "queue.SimpleQueue[Answer]") -> None:
    decode = msgspec.json.Decoder(Answer).decode
    while line := end.readline():
        answers.put(decode(line))
    end.close()


def _say(answers: IO[bytes], answer: Answer) -> None:
    with suppress(OSError):  # whoever asked is gone
        answers.write(msgspec.json.encode(answer) + b"\n")


def _open_end(end: IO[bytes] | None) -> IO[bytes]:
    if end is None:
        raise DeviceError("the device's process has no pipe")
    return end


def main() -> None:
    """Open the device that the arguments name and serve it."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    orders, answers = open(0, "rb", buffering=0, closefd=False), open(1, "wb", buffering=0, closefd=False)  # noqa: SIM115
    path, argument = sys.argv[1:]
    module, _, name = path.partition(":")
    try:
        device = getattr(import_module(module), name)(argument)
    except HaptigraphError as error:
        _say(answers, Answer(0, str(error)))
        return
    _say(answers, Answer(0, "", device.capabilities))
    Ward(device).serve(orders, answers)


if __name__ == "__main__":
    main()
