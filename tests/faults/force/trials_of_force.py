"""Faults of runs that push a hand, judged by the forces that reach the device."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from fault_rig import SHARED_MS, STEADY, LatencyProbe, environment
from trials import Measured, promise

PROGRAM = Path(__file__).with_name("forced_run.py")
WAIT_S = 120.0
DEADMAN_MS, LET_GO_MS = 150, 20
ENDS_MS = 30
"""What the system needs to end a killed process with its pipes, or Python to obey a signal."""
SILENT_MS, REOPENED_MS, RETRY_MS = 125, 100, 2000
"""A process without a report for this time counts as hung; the one in reserve then opens the device."""
PUSHES_N = 0.02
AGAIN_S = 1.0
LIMITS_MS = {  # from the fault; of those of the device, from the exchange in which it fails
    ("run", "SIGKILL"): ENDS_MS + LET_GO_MS,
    ("run", "SIGTERM"): ENDS_MS + LET_GO_MS,
    ("run", "SIGSTOP"): DEADMAN_MS + LET_GO_MS,
    ("process", "SIGKILL"): REOPENED_MS,
    ("process", "SIGTERM"): LET_GO_MS,
    ("process", "SIGSTOP"): SILENT_MS + REOPENED_MS,
    ("device", "raise"): LET_GO_MS,
    ("device", "nan"): LET_GO_MS,
    ("device", "freeze"): LET_GO_MS,
    ("device", "jump"): LET_GO_MS,
    ("device", "speed"): LET_GO_MS,
    ("device", "hang"): SILENT_MS + REOPENED_MS,
    ("device", "disconnect"): RETRY_MS + REOPENED_MS,  # from when it is connected again
}
CASES = tuple(LIMITS_MS)


class ForcedRun:
    """A run whose force device writes down every force."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "forces"
        arguments = ["run", f"phantom:{STEADY}", "--procedure", "subretinal_injection_force"]
        self.output = (folder / "output").open("wb")
        self.run = subprocess.Popen(
            [sys.executable, str(PROGRAM), *arguments, "--force", f"traced:{folder}"],
            stdout=self.output, stderr=subprocess.STDOUT, env=environment(),
        )  # fmt: skip
        self.probe = LatencyProbe()

    def __enter__(self) -> "ForcedRun":
        return self

    def __exit__(self, *error: object) -> None:
        self.probe.is_stopped.set()
        with suppress(ProcessLookupError):
            os.kill(self.run.pid, signal.SIGCONT)
        self.run.kill()
        self.run.wait(WAIT_S)
        self.output.close()

    def said(self) -> str:
        return (self.folder / "output").read_text(errors="replace")

    def lines(self) -> list[tuple[int, int, list[str]]]:
        """Return when, by which process, and what: every force, fault and end that the device noted."""
        try:
            lines = [line.split() for line in self.log.read_text().splitlines()]
        except FileNotFoundError:
            return []
        return [(int(line[0]), int(line[1]), line[2:]) for line in lines if len(line) > 2]

    def forces(self) -> list[tuple[int, int, float]]:
        return [(at_ns, who, float(what[1])) for at_ns, who, what in self.lines() if what[0] == "force"]

    def until_it_pushes(self) -> int:
        """Wait until it pushes; return the process that does."""
        give_up_s = time.monotonic() + WAIT_S
        while time.monotonic() < give_up_s:
            if (forces := self.forces()) and forces[-1][2] > PUSHES_N:
                return forces[-1][1]
            promise(self.run.poll() is None, f"the run has ended: {self.said()[-300:]}")
            time.sleep(0.01)
        promise(False, f"it never pushes: {self.said()[-300:]}")
        return 0

    def fail(self, how: str) -> None:
        """Let the device fail, or work again."""
        part = self.folder / "fault.part"
        part.write_text(how)
        part.rename(self.folder / "fault")

    def fault_ns(self, how: str) -> int:
        """Return when the device first failed like this."""
        give_up_s = time.monotonic() + WAIT_S
        while time.monotonic() < give_up_s:
            for at_ns, _, what in self.lines():
                if what == ["fault", how]:
                    return at_ns
            time.sleep(0.01)
        raise AssertionError(f"the device never failed by {how}")

    def let_go_ns(self, since_ns: int) -> int:
        """Wait until a force of zero arrives after a time; return when."""
        give_up_s = time.monotonic() + WAIT_S
        while time.monotonic() < give_up_s:
            for at_ns, _, force_n in self.forces():
                if at_ns >= since_ns and force_n == 0.0:
                    return at_ns
            time.sleep(0.01)
        raise AssertionError("it was never let go")


def is_alive(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def forced_hand(rng: random.Random, folder: Path) -> Measured:
    """Run, process or device fails while the hand is pushed: it is let go in time, and it is said."""
    who, how = rng.choice(CASES)
    with ForcedRun(folder) as forced:
        child = forced.until_it_pushes()
        time.sleep(rng.uniform(0.0, 0.3))
        child = forced.until_it_pushes()
        began_ns = time.monotonic_ns()
        if who == "device":
            forced.fail(how)
            began_ns = forced.fault_ns(how)
        else:
            os.kill(forced.run.pid if who == "run" else child, getattr(signal, how))
        if how == "disconnect":  # nothing can reach the device before it is back
            time.sleep(0.3)
            forced.fail("")
            began_ns = time.monotonic_ns()
        let_go_ns = forced.let_go_ns(began_ns)
        let_go_ms = (let_go_ns - began_ns) / 1e6
        busy_ms = forced.probe.late_ms(began_ns, let_go_ns) + SHARED_MS
        limit_ms = LIMITS_MS[who, how]
        what = f"{how} of the {who}"
        promise(
            let_go_ms <= limit_ms + busy_ms,
            f"{what}: let go after {let_go_ms:.0f} ms (busy {busy_ms:.0f} ms)",
        )
        _judge_afterwards(forced, who, how, child, let_go_ns, what)
    return Measured(what, round(max(let_go_ms, 0.0), 1))


def _judge_afterwards(forced: ForcedRun, who: str, how: str, child: int, let_go_ns: int, what: str) -> None:
    """Judge that what ends leaves nothing behind, and that what goes on says what happened, and pushes again."""
    if who == "run" and how != "SIGSTOP":
        give_up_s = time.monotonic() + WAIT_S
        while is_alive(child) and time.monotonic() < give_up_s:
            time.sleep(0.01)
        promise(not is_alive(child), f"{what}: the force process is left behind")
        promise(forced.lines()[-1][2] == ["closed"], f"{what}: the device is not closed")
        promise(
            not any(force_n for at_ns, _, force_n in forced.forces() if at_ns > let_go_ns),
            f"{what}: it pushes",
        )
        return
    time.sleep(0.3)
    if who == "run":
        promise(forced.forces()[-1][2] == 0.0, f"{what}: it pushes again while the run is stopped")
        os.kill(forced.run.pid, signal.SIGCONT)
    if who == "device" and how not in ("hang", "disconnect"):
        forced.fail("")
    if who == "device" and how == "hang":
        promise(not is_alive(child), f"{what}: the process that hangs is left behind")
    before_ns = time.monotonic_ns()
    give_up_s = time.monotonic() + WAIT_S
    while not any(force_n > PUSHES_N for at_ns, _, force_n in forced.forces() if at_ns > before_ns):
        promise(forced.run.poll() is None, f"{what}: the run has ended: {forced.said()[-300:]}")
        promise(time.monotonic() < give_up_s, f"{what}: it does not push again")
        time.sleep(0.02)
    promise("! force: traced:" in forced.said(), f"{what}: nothing was said")
