import pytest
from helpers import make_step
from msgspec.structs import replace

pytest.importorskip("cyclonedds")
import numpy as np

from haptigraph.bridges.diagnostics import ERROR, OK, WARN, RunDiagnostics
from haptigraph.messages import Capture, Fault, Timing

IMAGE = np.zeros((2, 2), np.uint8)
STEP_NS = 20_000_000


def diagnosed(*, faults=(), image=IMAGE, seconds=1):
    diagnostics, summaries = RunDiagnostics("rig", 10**18), []
    for number in range(50 * seconds + 1):
        step = make_step(stamp_ns=number * STEP_NS, faults=faults if number == 10 else ())
        step = replace(step, timing=Timing(0, step.stamp_ns + 5_000_000, {}))
        summary = diagnostics.add(Capture(number, number * STEP_NS, image), step)
        if summary is not None:
            summaries.append(summary)
    return summaries


def test_a_healthy_loop_is_summarised_once_a_second():
    summaries = diagnosed(seconds=3)
    assert [summary.status[0].level for summary in summaries] == [OK] * 3
    values = {pair.key: pair.value for pair in summaries[1].status[0].values}
    assert values == {
        "state": "some_state", "image_rate_hz": "50.0", "step_rate_hz": "50.0", "longest_latency_ms": "5.0",
    }  # fmt: skip
    assert summaries[0].header.stamp.ns == 10**18 + 10**9
    assert (summaries[0].status[0].name, summaries[0].status[0].message) == ("rig: loop", "ok")


def test_a_fault_is_a_warning_for_its_second():
    summaries = diagnosed(faults=(Fault("device", "unplugged"),), seconds=2)
    assert [summary.status[0].level for summary in summaries] == [WARN, OK]
    assert summaries[0].status[0].message == "device: unplugged"
    assert {pair.key: pair.value for pair in summaries[0].status[0].values}[
        "fault 1"
    ] == "device: unplugged (1 times)"


def test_a_second_without_images_is_an_error():
    (summary,) = diagnosed(image=None)
    assert summary.status[0].level == ERROR
