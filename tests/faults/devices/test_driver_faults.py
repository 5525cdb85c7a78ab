"""After any fault on the way to a driver chip, its motor is silent in time, and it resumes."""

import random
import signal
import time

import pytest
from fault_rig import DEADMAN_MS, ENABLE_PIN, PERIOD_MS, Rig
from trials_of_driver import ENABLED, FAULTS, begin, end, first_silence, until_recovered

pytest.importorskip("serial")

NEEDS_NO_PIN = [fault for fault in FAULTS if fault not in ENABLED]


@pytest.mark.parametrize(
    ("enable_pin", "faults"),
    [(ENABLE_PIN, FAULTS), (None, NEEDS_NO_PIN)],
    ids=["enable pin", "no enable pin"],
)
def test_a_fault_is_silenced_in_time_and_reported_and_vibration_resumes(enable_pin, faults, tmp_path):
    rng = random.Random(4)
    with Rig(tmp_path, "drv2605", enable_pin=enable_pin) as rig:
        for fault in faults:
            until_recovered(rig)
            rig.begin("none")  # discards earlier output
            began_ns = time.monotonic_ns()
            begin(fault, rng, rig.monitor.board)
            silent_ns = first_silence(rig, began_ns)
            rig.in_time(fault, began_ns, silent_ns, DEADMAN_MS + PERIOD_MS["drv2605"])
            rig.until_output("! device: ")
            end(fault, rig.monitor.board)
        until_recovered(rig)
        rig.silent_in_time("SIGINT", rig.signal(signal.SIGINT))
        code, out, err = rig.finish()
        assert (code, "Traceback" in err) == (0, False), err
        assert "interrupted" in out + err


def test_a_killed_run_is_silent(tmp_path):
    with Rig(tmp_path, "drv2605") as rig:
        rig.until_vibrating()
        rig.silent_in_time("SIGKILL", rig.signal(signal.SIGKILL))
        assert rig.finish()[0] == -signal.SIGKILL


def test_a_chip_that_does_not_listen_at_the_end_is_said_last_and_in_the_exit_code(tmp_path):
    with Rig(tmp_path, "drv2605") as rig:
        rig.until_vibrating()
        rig.monitor.board.drivers[0].answers = False
        rig.signal(signal.SIGINT)
        code, out, err = rig.finish()
        assert code == 2
        last = (out + err).splitlines()[-1]
        assert last.endswith("does not confirm silence; it may still vibrate: switch it off")
