"""Ends of runs: by a signal, without a terminal, at an unusable image."""

import signal
import subprocess
import sys

import pytest
from helpers import call

from haptigraph.commands.terminal import terminable
from haptigraph.recording.reader import RunReader


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


def test_an_interrupted_demo_ends_with_its_summary(quick, tmp_path, monkeypatch):
    interrupt_after(monkeypatch, 20)
    result = call("demo", "--fast", "--scenario", quick, "--output", tmp_path)
    assert result.exit_code == 0
    assert "interrupted" in result.stdout
    assert "replayed" not in result.stdout
    assert [file.name for file in tmp_path.iterdir()] == ["demo.mcap"]


def test_a_run_ended_by_an_unusable_image_prints_summary_and_recording(tmp_path, registration_toml):
    import numpy as np

    from haptigraph.recording.codec import encode_png

    folder, eye, record = tmp_path / "imgs", tmp_path / "eye.toml", tmp_path / "run.mcap"
    folder.mkdir()
    eye.write_text(registration_toml)
    for number, size in enumerate([(240, 320), (240, 320), (24, 32)]):
        (folder / f"{number}.png").write_bytes(encode_png(np.zeros((*size, 3), np.uint8)))
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
