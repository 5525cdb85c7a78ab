"""Ends of runs: by a signal, without a terminal, at an unusable image."""

import signal
import subprocess
import sys

import numpy as np
import pytest
import stuck_device
from helpers import call

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.commands.terminal import terminable
from haptigraph.recording.codec import encode_png
from haptigraph.recording.reader import RunReader

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_run_cleanly_with_its_summary(quick_uri, tmp_path, ending):
    record = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "haptigraph", "run", quick_uri, "--record", str(record)]
    with subprocess.Popen(
        [*command, "--set", "source.loop=true"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        for line in child.stderr:
            if "misaligned_intraocular_navigation" in line:
                break
        child.send_signal(ending)
        out, err = child.communicate(timeout=60)
    assert child.returncode == 0, err
    assert "interrupted" in out
    assert RunReader(record).is_whole
    assert "Traceback" not in err


def interrupt_after(monkeypatch, count):
    """Press Ctrl-C when the console receives step `count`."""
    from haptigraph.sinks.console import ConsoleSink

    write, steps = ConsoleSink.write, []

    def interrupted(self, capture, step):
        steps.append(step)
        if len(steps) == count:
            raise KeyboardInterrupt
        write(self, capture, step)

    monkeypatch.setattr(ConsoleSink, "write", interrupted)


@pytest.fixture
def stuck(monkeypatch):
    monkeypatch.setitem(assemble.DEVICES, "stuck", stuck_device.PATH)
    return "stuck"


def unusable_images(tmp_path, registration_toml):
    """Write a folder of images whose third does not fit, and a registration; return their paths."""
    folder, eye = tmp_path / "imgs", tmp_path / "eye.toml"
    folder.mkdir()
    eye.write_text(registration_toml)
    for number, size in enumerate([(240, 320), (240, 320), (24, 32)]):
        (folder / f"{number}.png").write_bytes(encode_png(np.zeros((*size, 3), np.uint8)))
    return folder, eye


def test_a_run_without_confirmed_silence_says_so_last_and_fails(quick_uri, stuck):
    result = call("run", quick_uri, "--fast", "--device", stuck)
    assert (result.exit_code, result.stderr.splitlines()[-1]) == (2, stuck_device.NOT_SILENT)
    assert "source ended" in result.stdout


def test_a_failed_run_without_confirmed_silence_gives_both_reasons(tmp_path, registration_toml, stuck):
    folder, eye = unusable_images(tmp_path, registration_toml)
    result = call("run", folder, "--registration", eye, "--device", stuck)
    *_, reason, last = result.stderr.splitlines()
    assert (result.exit_code, last) == (2, stuck_device.NOT_SILENT)
    assert (
        reason
        == f"haptigraph: {folder}, image 2: image is 32 x 24 px, but the registration is for 320 x 240 px"
    )


def test_a_test_of_a_device_without_confirmed_silence_fails(stuck, monkeypatch):
    monkeypatch.setattr("haptigraph.clock.MonotonicClock", VirtualClock)
    result = call("devices", "test", stuck)
    assert (result.exit_code, result.stderr.splitlines()[-1]) == (2, stuck_device.NOT_SILENT)


def test_an_interrupted_demo_ends_with_its_summary(quick, tmp_path, monkeypatch):
    interrupt_after(monkeypatch, 20)
    result = call("demo", "--fast", "--scenario", quick, "--output", tmp_path)
    assert result.exit_code == 0
    assert "interrupted" in result.stdout
    assert "replayed" not in result.stdout
    assert [file.name for file in tmp_path.iterdir()] == ["demo.mcap"]


def test_a_run_ended_by_an_unusable_image_prints_summary_and_recording(tmp_path, registration_toml):
    (folder, eye), record = unusable_images(tmp_path, registration_toml), tmp_path / "run.mcap"
    result = call("run", folder, "--registration", eye, "--record", record)
    assert result.exit_code == 2
    assert "2 steps" in result.stdout
    assert f"recording       {record}" in result.stdout
    assert f"haptigraph: {folder}, image 2: image is 32 x 24 px" in result.stderr
    assert RunReader(record).is_whole


def test_a_closed_pipe_does_not_end_the_run(quick_uri, tmp_path):
    record = tmp_path / "run.mcap"
    command = f"{sys.executable} -m haptigraph run {quick_uri} --fast --record {record} 2>&1 | true"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("", "")
    reader = RunReader(record)
    assert reader.is_whole
    assert reader.count()[0] == 117


def test_a_run_under_nohup_survives_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with terminable():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
