import json
import subprocess
import sys

import numpy as np
import pytest
from helpers import call, refuse
from msgspec.structs import replace

from haptigraph.analysis.robot.sync import check_sync, correct, robot_note
from haptigraph.geometry import subtract, unit
from haptigraph.messages import OFF, Delivered, HandState, HapticCommand, Observation, Pattern, Timing
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import RunWriter

LOW = Pattern("low", "continuous", amplitude=0.3)


def test_a_lag_is_found_reported_and_fails(late_run):
    result = call("sync-check", late_run)
    assert result.exit_code == 1 and "not aligned" in result.output
    report = json.loads(call("sync-check", late_run, "--json").stdout)
    low, high = report["robot"]["interval_s"]
    assert low < 0.12 < high < 0.13 and report["touch"] is None


def test_an_aligned_run_passes(aligned_run):
    result = call("sync-check", aligned_run)
    assert result.exit_code == 0 and "not aligned" not in result.output


def test_a_corrected_copy_is_aligned_and_says_so(late_run, tmp_path):
    copy = tmp_path / "copy.mcap"
    before = late_run.read_bytes()
    assert call("sync-check", late_run, "--correct", copy).exit_code == 0
    assert late_run.read_bytes() == before
    report = check_sync(copy)
    low, high = report.robot.interval_s
    assert report.is_robot_aligned and low < 0.002 and high > -0.002
    assert "moved by -1" in RunReader(copy).info.robot_shift and report.shifted
    kept, moved = (
        [(capture, step) for capture, step in RunReader(path).records(images=())] for path in (late_run, copy)
    )
    assert [step for _, step in kept] == [step for _, step in moved]
    samples = [one.stamp_ns for capture, _ in moved for one in capture.robot]
    assert samples == sorted(samples) and all(
        one.stamp_ns <= capture.stamp_ns for capture, _ in moved for one in capture.robot
    )


def test_nothing_is_overwritten(late_run, tmp_path):
    there = tmp_path / "there.mcap"
    there.write_bytes(b"mine")
    with pytest.raises(Exception, match="never overwrites"):
        correct(late_run, there, check_sync(late_run).robot)
    assert there.read_bytes() == b"mine"


def test_a_run_without_robot_is_refused(aligned_run, tmp_path):
    assert "no robot measurements" in refuse("sync-check", without_robot(aligned_run, tmp_path))


def without_robot(path, folder):
    return rewritten(path, folder / "bare.mcap", lambda capture, step: ({"robot": ()}, {}))


def rewritten(path, copy, changes):
    """A copy of a recording whose captures and steps have other fields."""
    from haptigraph.analysis.metrics.replay import recorded_registration

    reader = RunReader(path)
    writer = RunWriter(copy, reader.info, recorded_registration(reader).image, ())
    for capture, step in reader.records():
        of_capture, of_step = changes(capture, step)
        writer.write(replace(capture, **of_capture), replace(step, **of_step))
    writer.close()
    return copy


def led(path, copy, lead_s, scale=0.2, has_robot=True):
    """A copy whose tip followed a hand, after a time; the hand had a clutch that was pressed throughout."""
    records = list(RunReader(path).records(images=()))
    stamps_s = np.array([capture.stamp_ns for capture, _ in records]) / 1e9
    tips_mm = np.array([capture.truth.tip_mm for capture, _ in records])
    there_mm = np.column_stack([np.interp(stamps_s + lead_s, stamps_s, column) for column in tips_mm.T])
    steps = iter(np.diff(there_mm, axis=0, prepend=there_mm[:1]) / scale)

    def moved(capture, step):
        line = step.observation.found["needle_line"]
        u, v = unit(subtract(line.end_mm, line.start_mm))
        x, y = next(steps).tolist()
        along_mm, across_mm = x * u + y * v, y * u - x * v
        hand = HandState(True, along_mm, across_mm, scale * along_mm, scale * across_mm, scale, False, 0.0)
        return {"hand": hand} | ({} if has_robot else {"robot": ()}), {}

    return rewritten(path, copy, moved)


def test_the_delay_of_the_tip_after_the_hand_is_found_without_a_robot(aligned_run, tmp_path):
    result = call("sync-check", led(aligned_run, tmp_path / "led.mcap", 0.08, has_robot=False))
    assert result.exit_code == 0 and "ms after the hand that leads it" in result.output
    report = check_sync(tmp_path / "led.mcap")
    low, high = report.hand.interval_s
    assert report.robot is None and high - low < 0.04
    assert low - 0.002 < -0.08 < high + 0.002
    assert "no robot whose stamps" in refuse(
        "sync-check", tmp_path / "led.mcap", "--correct", tmp_path / "new.mcap"
    )


def test_a_tip_that_moves_before_its_hand_is_not_aligned(aligned_run, tmp_path):
    result = call("sync-check", led(aligned_run, tmp_path / "led.mcap", -0.08))
    assert result.exit_code == 1 and "before the hand that leads it" in result.output
    assert check_sync(tmp_path / "led.mcap").is_robot_aligned


def test_a_hand_that_did_not_lead_the_tip_is_reported_as_unknown(aligned_run, tmp_path):
    still = HandState(True, 0.0, 0.0, 0.0, 0.0, 0.2, False, 0.0)
    idle = rewritten(aligned_run, tmp_path / "idle.mcap", lambda capture, step: ({"hand": still}, {}))
    result = call("sync-check", idle)
    assert result.exit_code == 0 and "hand            not known: too little motion" in result.output
    bare = rewritten(
        aligned_run, tmp_path / "bare.mcap", lambda capture, step: ({"hand": still, "robot": ()}, {})
    )
    assert "too little motion" in refuse("sync-check", bare)


def test_a_note_says_whether_a_robot_is_aligned_and_what_is_not_known(late_run, aligned_run, tmp_path):
    assert "aligned, as far as the interval says" in robot_note(aligned_run)
    note = robot_note(late_run)
    assert "stamped +12" in note and "sync-check --correct" in note
    blind = rewritten(
        aligned_run,
        tmp_path / "blind.mcap",
        lambda capture, step: ({}, {"observation": Observation(step.stamp_ns, {})}),
    )
    assert "is not known: has no image in which a needle's tip" in robot_note(blind)


@pytest.mark.parametrize(
    "code",
    [
        "from haptigraph.cli import main; main(['sync-check', sys.argv[1]])",
        "from haptigraph.commands.recordings import _robot_line; print(_robot_line(sys.argv[1]))",
    ],
    ids=["sync-check", "replay"],
)
def test_without_scipy_the_extra_is_named_in_one_sentence(aligned_run, code):
    hidden = f"import sys; sys.modules['scipy'] = None; {code}"
    program = [sys.executable, "-c", hidden, str(aligned_run)]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert said.endswith(
        "comparing clocks needs an extra; install it with: pip install 'haptigraph[analysis]'\n"
    )
    assert said.count("\n") == 1


@pytest.mark.parametrize("onsets", [7, 9])
def test_touch_is_compared_with_its_command_if_it_came_often_enough(late_run, tmp_path, onsets):
    count = 0

    def confirm(capture, step):
        """Vibrate in every second run of ten images; the output confirms 12 ms after the command."""
        nonlocal count
        count += 1
        begun, is_first = divmod(count - 10, 20)
        vibrates = 0 <= begun < onsets and is_first < 10
        command = HapticCommand(step.stamp_ns, LOW if vibrates else OFF, step.stamp_ns)
        start_ns = step.stamp_ns + 12_000_000
        delivered = (Delivered(start_ns, start_ns + 20_000_000, "pad"),) if vibrates and not is_first else ()
        return {"delivered": delivered}, {
            "command": command,
            "timing": Timing(step.stamp_ns, step.stamp_ns, {}),
        }

    touch = check_sync(rewritten(late_run, tmp_path / "felt.mcap", confirm)).touch
    if onsets < 8:
        assert touch is None
    else:
        assert (touch.median_ms, touch.longest_ms, touch.count) == (12.0, 12.0, onsets)
