"""Run a device in a watchdog process, which silences it when the run dies (even by kill -9) or hangs.

For actuators that hold their last output. Run as a program, this module is that process: it reads commands
from its standard input, acknowledges and executes each, and silences the device when none arrives for
`HOLDS_MS`, at the end of the input, and on SIGTERM. It exits with 0 only if the device confirmed silence.
`run_device` chooses the class of the device.

The run, in turn, watches this process: if it ends or acknowledges nothing, it is killed, and a second one,
which waits in reserve, opens the device: opening it silences it.
"""

import queue
import subprocess
import sys
import threading
import time
import warnings
from contextlib import suppress
from importlib import import_module
from typing import IO

import msgspec
from msgspec.structs import replace

from haptigraph.child_process import obey_sigterm_only, pipe_of, program_of
from haptigraph.errors import BadInput, DeviceError, HaptigraphError
from haptigraph.haptics.descriptors import DescriptorReserve
from haptigraph.haptics.watchdog_process import GO, Command, Reply, WatchdogProcess
from haptigraph.importing import load
from haptigraph.stages import Device, check_members

__all__ = ["WatchdogServer", "WatchedDevice", "main"]

HOLDS_MS = 150.0
REPLY_S = 0.25
MAX_UNANSWERED = 3  # commands without acknowledgement before the process is replaced
ACKNOWLEDGE_S = 0.15
START_S = 20.0  # imports, and a board that restarts
CLOSE_S = 2.0
RESERVED = 16  # descriptors of the pipes to a new process, and of its start


class WatchedDevice:
    """Forward everything to a device in a watchdog process, and keep another one in reserve.

    Args:
        device: "module:Class" of the device.
        argument: The argument of the class.
        library: The module that opening it imports; a process in reserve has imported it before.

    Raises:
        BadInput: If the device cannot be opened.
    """

    def __init__(self, device: str, argument: str, library: str) -> None:
        self._arguments = [*program_of("haptigraph.haptics.watchdog"), device, argument, library]
        self._descriptors = DescriptorReserve(RESERVED)
        self._number = 0
        self._closed = False
        self._reserve: WatchdogProcess | None = None
        self._active = self._started()
        self._active.go()
        self._refill()
        opened = self._reply(0, START_S)
        if opened is None or opened.capabilities is None:
            self._release()
            raise BadInput(opened.error if opened else f"device {argument} does not open")
        self.capabilities = replace(opened.capabilities, holds_ms=HOLDS_MS)
        self._active.is_open = True

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Send a command and wait until it is executed; replace a process that has ended or hangs."""
        if self._active.process.poll() is not None:
            self._replace()
        if not self._active.is_open:
            self._await_open(REPLY_S)
        command = Command(0, amplitude, frequency_hz, stamp_ns)
        reply = self._acknowledgement(command)
        if not reply.is_executed:
            executed = self._reply(reply.number, REPLY_S, is_executed=True)
            if executed is None:
                self._acknowledgement(command)  # it may have hung since
                raise DeviceError("the device does not respond")
            reply = executed
        if reply.error:
            raise DeviceError(reply.error)

    def close(self) -> None:
        """Silence and release the device, end its process; a process that hangs is replaced to do so.

        Raises:
            DeviceError: If the device did not confirm that it is silent.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if not self._ends_silent(CLOSE_S):
                self._replace()
                if not self._ends_silent(START_S):
                    raise DeviceError("does not confirm silence")
        finally:
            self._release()

    def _release(self) -> None:
        for child in filter(None, (self._active, self._reserve)):
            child.kill()
        self._descriptors.release()

    def _ends_silent(self, within_s: float) -> bool:
        """Let the process silence the device and end; return whether the device confirmed silence."""
        process = self._active.process
        pipe_of(process.stdin).close()
        try:
            return process.wait(within_s) == 0
        except subprocess.TimeoutExpired:
            return False

    def _started(self) -> WatchdogProcess:
        with self._descriptors.released():
            return WatchdogProcess(self._arguments)

    def _refill(self) -> None:
        """Start a process in reserve, if one can be started."""
        with suppress(OSError):
            self._reserve = self._started()

    def _spare(self) -> WatchdogProcess:
        """Return the process in reserve, or a new one if there is none that lives."""
        if self._reserve is None:
            return self._started()
        if self._reserve.process.poll() is None:
            return self._reserve
        self._reserve.kill()  # closes its pipe
        return self._started()

    def _replace(self) -> None:
        """Kill the process and let the one in reserve open the device, which silences it."""
        self._active.kill()
        try:
            self._active, self._reserve = self._spare(), None
        except OSError as error:
            raise DeviceError(f"its process cannot be started ({error.strerror})") from None
        self._active.go()
        if not self._closed:
            self._refill()

    def _acknowledgement(self, command: Command) -> Reply:
        """Send a command until it is acknowledged; replace a process that does not."""
        for _ in range(MAX_UNANSWERED):
            self._number += 1
            self._active.write(msgspec.json.encode(replace(command, number=self._number)) + b"\n")
            reply = self._reply(self._number, ACKNOWLEDGE_S)
            if reply is not None:
                return reply
        self._replace()
        raise DeviceError("its process did not answer, and was replaced")

    def _await_open(self, within_s: float) -> None:
        opened = self._reply(0, within_s)
        if opened is None and time.monotonic() - self._active.called_s > START_S:
            self._replace()
        if opened is None or opened.error:
            raise DeviceError(opened.error if opened else "its process is starting")
        self._active.is_open = True

    def _reply(self, number: int, within_s: float, *, is_executed: bool = False) -> Reply | None:
        """Return the next reply to a command, or to its execution; None if none comes in time."""
        give_up_s = time.monotonic() + within_s
        with suppress(queue.Empty):
            while True:
                reply = self._active.replies.get(timeout=max(give_up_s - time.monotonic(), 0))
                if reply.number == number and (reply.is_executed or not is_executed):
                    return reply
                if reply.number == 0 and reply.error:
                    return reply
        return None


class WatchdogServer:
    """The watchdog's side: execute commands, and silence the device when they stop.

    Args:
        device: The device.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._commands: queue.SimpleQueue[tuple[float, Command | None]] = queue.SimpleQueue()
        self._vibrates = False

    def serve(self, commands: IO[bytes], replies: IO[bytes]) -> None:
        """Execute commands until their stream ends; then the device is silent.

        Raises:
            DeviceError: If the device did not confirm that it is silent.
        """
        threading.Thread(target=self._read, args=(commands, replies), daemon=True).start()
        try:
            while (command := self._next()) is not None:
                _send(replies, Reply(command.number, self._execute(command)))
        finally:
            self._device.close()

    def _next(self) -> Command | None:
        """Return the newest command, silence if none arrives in time, None at the end."""
        try:
            received_s, command = self._commands.get(timeout=HOLDS_MS / 1e3 if self._vibrates else None)
            while not self._commands.empty():
                received_s, command = self._commands.get()
        except queue.Empty:
            return Command(-1, 0.0, 0.0, 0)
        if command is not None and time.monotonic() - received_s > HOLDS_MS / 1e3:
            command = replace(command, amplitude=0.0)  # outdated: the device was blocked meanwhile
        return command

    def _execute(self, command: Command) -> str:
        self._vibrates = command.amplitude > 0
        try:
            self._device.set(command.amplitude, command.frequency_hz, command.stamp_ns)
        except Exception as error:
            self._vibrates = True  # unknown, so silence is tried again
            return str(error) or type(error).__name__
        return ""

    def _read(self, commands: IO[bytes], replies: IO[bytes]) -> None:
        decode = msgspec.json.Decoder(Command).decode
        with suppress(OSError, msgspec.DecodeError):
            while line := commands.readline():
                command = decode(line)
                self._commands.put((time.monotonic(), command))
                _send(replies, Reply(command.number, is_executed=False))
        self._commands.put((time.monotonic(), None))


def _send(replies: IO[bytes], reply: Reply) -> None:
    with suppress(OSError):  # the run is gone
        replies.write(msgspec.json.encode(reply) + b"\n")


def _import_ahead(library: str) -> None:
    """Import a library; if it is missing, opening the device says so."""
    with suppress(ImportError, HaptigraphError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import_module(library)


def main() -> None:
    """Open the device that the arguments specify and serve it."""
    obey_sigterm_only(sys.exit)
    commands, replies = open(0, "rb", buffering=0, closefd=False), open(1, "wb", buffering=0, closefd=False)  # noqa: SIM115
    path, argument, library = sys.argv[1:]
    try:
        kind = load(path)
        _import_ahead(library)
        if commands.readline() != GO:
            sys.exit(1)  # the run ended, and never needed this process
        device = kind(argument)
        check_members(device, Device, f"device {path}")
    except Exception as error:  # also any of a device of the user's own
        found = str(error) if isinstance(error, HaptigraphError) else f"{type(error).__name__}: {error}"
        _send(replies, Reply(0, found))
        sys.exit(1)
    _send(replies, Reply(0, "", device.capabilities))
    try:
        WatchdogServer(device).serve(commands, replies)
    except (HaptigraphError, OSError):
        sys.exit(1)


if __name__ == "__main__":
    main()
