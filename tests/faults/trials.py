"""Faults drawn at random against the real program: one function for each line of the table in docs/explanation/faults.md.

A trial gets a random generator and an empty folder, breaks something, and judges from outside: from the bytes
at the actuator's end, from files, exit codes and output. It raises `BrokenPromise`, or returns what it measured.
"""

import os
import random
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import msgspec
from damages import DAMAGES, GENERAL_DAMAGES, content
from msgspec import Struct
from real_run import DEADMAN_MS, PERIOD_MS, Rig, environment

from haptigraph.errors import BadInput
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.reader import RunReader

DATA = Path(__file__).parents[1] / "data"
REPLACED_MS = 1000
"""Until the process in reserve has silenced the device of one that hangs or was killed."""
MAX_CONNECTIONS, SPARE = 100, 20
"""Connections that the server keeps, and descriptors that a new watchdog process and its pipes may need."""
HALVES = (b"", b"G", b"GET / HTTP/1.1\r\nHost: 127.0", b"POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\n{")


class BrokenPromise(AssertionError):
    """What the program did, against what it promises."""


class Measured(Struct):
    what: str
    """The fault."""
    silence_ms: float | None = None
    """From the fault until the actuator was silent."""
    lost: int = 0
    """Steps or images that are missing, all of them reported."""


Trial = Callable[[random.Random, Path], Measured]


def promise(kept: object, text: str) -> None:
    if not kept:
        raise BrokenPromise(text)


def program(*arguments: object, **options) -> subprocess.CompletedProcess:
    """Run a command to its end; a traceback or a very long message breaks a promise."""
    command = [sys.executable, "-m", "haptigraph", *map(str, arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", timeout=120, env=environment(), **options
    )
    promise("Traceback" not in done.stderr, f"a traceback: {done.stderr[-300:]}")
    if done.returncode == 2:
        last = done.stderr.splitlines()[-1] if done.stderr else ""
        promise(last.startswith("haptigraph: "), f"exit code 2 with {last[:200]!r}")
        promise(len(last) < 1000, f"a message of {len(last)} characters")
    return done


def judge_silence(rig: Rig, what: str, began_ns: int, silent_ns: int, promised_ms: float) -> float:
    late_ms = (silent_ns - began_ns) / 1e6
    busy_ms = rig.probe.late_ms(began_ns, silent_ns)
    promise(
        late_ms <= promised_ms + busy_ms, f"{what}: silent after {late_ms:.0f} ms (busy {busy_ms:.0f} ms)"
    )
    return round(late_ms, 1)


def judge_end(rig: Rig, *, code: int = 0) -> str:
    ended, out, err = rig.finish()
    promise("Traceback" not in err, f"a traceback: {err[-300:]}")
    promise(ended == code, f"exit code {ended} instead of {code}: {err[-200:]}")
    return out + err


# --- the actuator ---------------------------------------------------------------------------------------


def hung_process(rng: random.Random, folder: Path) -> Measured:
    """The device's process hangs, during the run or just before its end."""
    device, ending = rng.choice(("serial", "gamepad")), rng.choice((None, "SIGINT", "SIGTERM", "SIGHUP"))
    what = f"{device} process hangs, {ending or 'the run goes on'}"
    with Rig(folder, device) as rig:
        rig.until_vibrating()
        time.sleep(rng.uniform(0, 0.5))
        hung, began_ns = rig.watchdog(), time.monotonic_ns()
        os.kill(hung, signal.SIGSTOP)
        if ending is None:
            silent_ns = rig.monitor.until_silent_once(began_ns)
            rig.monitor.until(vibrates=True)
            rig.signal(signal.SIGINT)
            judge_end(rig)
        else:
            time.sleep(rng.uniform(0, 0.6))
            rig.signal(getattr(signal, ending))
            judge_end(rig)
            promise(not rig.monitor.vibrates, f"{what}: vibrates after the end")
            silent_ns = max(rig.monitor.until_silent_once(began_ns), began_ns)
        promise(not Path(f"/proc/{hung}").exists(), f"{what}: the hung process is left behind")
        return Measured(what, judge_silence(rig, what, began_ns, silent_ns, REPLACED_MS))


def ended_run(rng: random.Random, folder: Path) -> Measured:
    """The run is killed, stopped or ended by a signal; or its board stops answering just before."""
    device = rng.choice(("serial", "gamepad"))
    how = rng.choice(("SIGKILL", "SIGSTOP", "SIGINT", "SIGTERM", "SIGHUP", "board does not answer"))
    what = f"{device}, {how}"
    with Rig(folder, device) as rig:
        rig.until_vibrating()
        time.sleep(rng.uniform(0, 0.5))
        if how == "board does not answer" and device == "serial":
            rig.monitor.board.responds = False
            rig.signal(signal.SIGINT)
            output = judge_end(rig, code=2)
            last = output.splitlines()[-1]
            promise("does not confirm silence; it may still vibrate" in last, f"the last line is {last!r}")
            return Measured(what)
        number = getattr(signal, how) if how.startswith("SIG") else signal.SIGINT
        began_ns = rig.signal(number)
        limit_ms = DEADMAN_MS + PERIOD_MS[device]
        silence_ms = judge_silence(rig, what, began_ns, rig.monitor.until(vibrates=False), limit_ms)
        if number == signal.SIGSTOP:
            rig.signal(signal.SIGKILL)
        judge_end(rig, code=-signal.SIGKILL if number in (signal.SIGKILL, signal.SIGSTOP) else 0)
        return Measured(what, silence_ms)


def half_open_connections(rng: random.Random, folder: Path) -> Measured:
    """Up to 1,024 connections that never complete a request, while the watchdog process is killed."""
    count = rng.randint(50, 1024)
    what = f"{count} half-open connections, watchdog killed"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (1024, 1024))

    with Rig(folder, "serial", "--recordings", str(folder), command="live", preexec_fn=limit) as rig:
        host, port = rig.until_output(r"the page is at http://(\S+?)/")[1].split(":")
        rig.until_vibrating()
        descriptors = Path(f"/proc/{rig.process.pid}/fd")
        before = len(list(descriptors.iterdir()))
        with ExitStack() as stack:
            for _ in range(count):
                line = stack.enter_context(socket.create_connection((host, int(port)), timeout=10))
                line.sendall(rng.choice(HALVES))
            time.sleep(rng.uniform(0, 0.5))
            began_ns = time.monotonic_ns()
            os.kill(rig.watchdog(), signal.SIGKILL)
            silent_ns = rig.monitor.until_silent_once(began_ns)
            silence_ms = judge_silence(rig, what, began_ns, silent_ns, REPLACED_MS)
            rig.monitor.until(vibrates=True)
            held = len(list(descriptors.iterdir())) - before
            promise(held <= MAX_CONNECTIONS + SPARE, f"{what}: they hold {held} descriptors")
            ended_ns = rig.signal(signal.SIGTERM)
            rig.monitor.until(vibrates=False)
        output = judge_end(rig)
        promise(len(output) < 20_000, f"{what}: a log of {len(output)} characters")
        judge_silence(
            rig, "SIGTERM", ended_ns, rig.monitor.until(vibrates=False), DEADMAN_MS + PERIOD_MS["serial"]
        )
        return Measured(what, silence_ms)


# --- recordings -----------------------------------------------------------------------------------------


def damaged(rng: random.Random, source: Path, target: Path) -> str:
    """Write a damaged copy of a file; return what was done to it."""
    ways = DAMAGES if source.suffix == ".mcap" else GENERAL_DAMAGES
    data, how = bytearray(source.read_bytes()), rng.choice(ways)
    how(data, rng)
    target.write_bytes(data)
    return f"{source.stem}: {how.__name__}"


def recovered(rng: random.Random, folder: Path, files: Path) -> Measured:
    """`recover` on a damaged journal or complete file."""
    _, truth = content(files / "whole.mcap")
    path = folder / "damaged.mcap"
    what = damaged(rng, files / rng.choice(("journal.mcap", "whole.mcap")), path)
    before = path.read_bytes()
    done = program("recover", path)
    if done.returncode == 2:
        promise(path.read_bytes() == before, f"{what}: refused, and changed")
        return Measured(f"{what}, refused")
    saved = folder / "damaged.recovered.mcap" if done.returncode == 1 else path
    promise(saved.exists(), f"{what}: exit code {done.returncode} without {saved.name}")
    left = content(saved)[1]
    promise(left.items() <= truth.items(), f"{what}: other content")
    if done.returncode == 1:
        promise(path.read_bytes() == before, f"{what}: the original was changed")
    lost = len(truth) - len(left)
    is_reported = done.returncode == 1 or "left out" in done.stdout + done.stderr or "truncate" in what
    promise(not lost or is_reported, f"{what}: {lost} steps lost in silence")
    return Measured(f"{what}, exit code {done.returncode}", lost=lost)


def replayed(rng: random.Random, folder: Path, files: Path, name: str) -> Measured:
    """`replay` of a damaged recording: never with exit code 0 unless everything is there."""
    count = len(content(files / "whole.mcap")[1])
    path = folder / "damaged.mcap"
    what = damaged(rng, files / name, path)
    done = program("replay", path)
    if done.returncode == 0:
        is_all = f"{count} of {count} steps identical" in done.stdout
        is_said = "truncate" in what and "incomplete" in done.stdout + done.stderr
        promise(is_all or is_said, f"{what}: exit code 0 with {done.stdout[:80]!r}")
    return Measured(f"{what}, exit code {done.returncode}")


def replayed_whole(rng: random.Random, folder: Path, files: Path) -> Measured:
    """`replay` of a damaged complete recording."""
    return replayed(rng, folder, files, "whole.mcap")


def replayed_journal(rng: random.Random, folder: Path, files: Path) -> Measured:
    """`replay` of a damaged journal, or of one whose header was changed."""
    if rng.random() < 0.7:
        return replayed(rng, folder, files, "journal.mcap")
    data = bytearray((files / "journal.mcap").read_bytes())
    digits = [
        at
        for at in range(data.index(b"procedure"), data.index(b"haptigraph.Capture"))
        if chr(data[at]).isdigit()
    ]
    data[rng.choice(digits)] ^= 1
    (folder / "damaged.mcap").write_bytes(data)
    done = program("replay", folder / "damaged.mcap")
    is_all = re.search(r"^(\d+) of \1 steps identical", done.stdout, re.MULTILINE)
    promise(done.returncode or is_all, "a digit of the header: other content with exit code 0")
    return Measured(f"a digit of the header, exit code {done.returncode}")


def recording_of(
    folder: Path, arguments: tuple, meddle: Callable[[Path], None], **options
) -> tuple[int, str]:
    record = folder / "run.mcap"
    command = [
        sys.executable,
        "-m",
        "haptigraph",
        "run",
        f"phantom:{DATA / 'quick.toml'}",
        "--record",
        str(record),
    ]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          env=environment(), **options) as run:  # fmt: skip
        meddle(record)
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=60)
    promise("Traceback" not in err, f"a traceback: {err[-300:]}")
    return run.returncode, out + err


def meddled(rng: random.Random, folder: Path) -> Measured:
    """Somebody deletes, moves, replaces or changes the recording while it is written."""
    how = rng.choice(("delete", "move", "replace", "truncate", "append"))
    wait_s = rng.uniform(0.2, 1.2)

    def meddle(record: Path) -> None:
        give_up_s = time.monotonic() + 30
        while not (record.exists() and record.stat().st_size > 50_000) and time.monotonic() < give_up_s:
            time.sleep(0.02)
        time.sleep(wait_s)
        if how == "delete":
            record.unlink()
        elif how == "move":
            record.rename(folder / "moved.mcap")
        elif how == "replace":
            (folder / "other").write_bytes(record.read_bytes()[: rng.randint(1, 50_000)])
            (folder / "other").replace(record)
        elif how == "truncate":
            os.truncate(record, rng.randint(0, record.stat().st_size - 1))
        else:
            with record.open("ab") as file:
                file.write(rng.randbytes(rng.randint(1, 3000)))

    code, output = recording_of(folder, ("--set", "source.loop=true"), meddle)
    promise(code, f"{how}: exit code 0")
    promise("is incomplete" in output, f"{how}: not said to be incomplete")
    return Measured(how)


def full_disk(rng: random.Random, folder: Path) -> Measured:
    """The disk fills near the end of a run: a limit of the file's size has the same effect."""
    limit_bytes = rng.randint(100_000, 1_300_000)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    code, output = recording_of(
        folder, ("--fast",), lambda record: time.sleep(rng.uniform(1.5, 3)), preexec_fn=limit
    )
    ran = re.search(r"loop +(\d+) steps", output)
    if ran is None:  # interrupted before the first step
        return Measured("full disk, no step")
    try:
        with not_being_written(folder / "run.mcap"):
            kept = RunReader(folder / "run.mcap").count()[0]
    except (BadInput, OSError):
        kept = 0
    lost = int(ran[1]) - kept
    promise(not lost or (code and "is incomplete" in output), f"{lost} steps lost, exit code {code}")
    return Measured("full disk", lost=max(lost, 0))


def schemas(rng: random.Random, folder: Path) -> Measured:
    """Every message of a recording satisfies the JSON schema in the file."""
    import fastjsonschema
    from mcap.reader import make_reader

    settings = rng.choice(
        ((), ("--set", "source.jpeg_quality=0"), ("--set", "perception.perceiver=threshold"))
    )
    done = program(
        "run", f"phantom:{DATA / 'quick.toml'}", "--fast", "--record", folder / "run.mcap", *settings
    )
    promise(done.returncode == 0, done.stderr[-200:])
    compiled: dict[int, Callable] = {}
    with (folder / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.id not in compiled:
                compiled[schema.id] = fastjsonschema.compile(msgspec.json.decode(schema.data))
            try:
                compiled[schema.id](msgspec.json.decode(message.data))
            except fastjsonschema.JsonSchemaValueException as error:
                raise BrokenPromise(f"{channel.topic}: {error.message}") from None
    promise("! source" not in done.stderr and "fault " not in done.stdout, "a normal end looks like a fault")
    return Measured(" ".join(settings) or "default")
