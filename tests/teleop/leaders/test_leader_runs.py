"""A whole run that a leader steers: the program, a pseudo-terminal as its keyboard, and its recording."""

import os
import signal
import subprocess
import sys
from select import select

import pytest

pytest.importorskip("termios")

import pty

from paths import DATA

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader

STEERED = f"teleop:{DATA / 'steered.toml'}"


@pytest.mark.realtime
def test_keys_steer_the_simulated_needle_and_the_recording_has_it(tmp_path):
    file = tmp_path / "run.mcap"
    hand, terminal = pty.openpty()
    command = [sys.executable, "-m", "haptigraph", "run", STEERED, "--leader", "keys", "--record", str(file)]
    presses, line = 0, b""
    with subprocess.Popen(
        command, bufsize=0, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as run:
        os.close(terminal)
        try:
            while b"retinal_approach" not in line:  # it starts 10 mm before that
                if select([run.stdout], [], [], 0.1)[0]:
                    line = run.stdout.readline()
                    assert line, "the run has ended"
                else:
                    os.write(hand, b"s")
                    presses += 1
                    assert presses < 600, f"it does not move; the last line: {line.decode()}"
            run.send_signal(signal.SIGINT)
            output = run.communicate(timeout=60)[0].decode()
        finally:
            run.kill()
            os.close(hand)
    assert run.returncode == 0, output
    moved_mm = [capture.hand.along_mm for capture, _ in RunReader(file).records() if capture.hand]
    assert any(each > 0 for each in moved_mm)
    assert 0 < sum(moved_mm) <= presses * 1.0 + 1e-6  # a press moves for at most 100 ms at 10 mm/s


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (
            (f"source.uri={STEERED}", "run.leader=gamepad:0", "run.realtime=false"),
            "--leader gamepad:0 works in real time; --fast is for files",
        ),
        (
            ("source.uri=phantom:align_then_approach", "run.leader=keys"),
            "--leader keys steers teleop; phantom:align_then_approach cannot be steered",
        ),
        (
            (f"source.uri={STEERED}", "run.leader=glove"),
            "unknown leader 'glove'; valid: crtk, gamepad, joy, keys",
        ),
        ((f"source.uri={STEERED}", "run.leader=keys:3"), "keys takes no argument"),
    ],
)
def test_a_leader_that_cannot_steer_is_refused(settings, problem):
    with pytest.raises(BadInput) as refusal:
        assemble.build(load_config(None, settings))
    assert problem in str(refusal.value)


def test_the_list_of_devices_has_leaders():
    from helpers import call

    result = call("devices")
    assert result.exit_code == 0
    assert "keys" in result.output.partition("Leaders")[2]
