from functools import partial
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from helpers import MS, ScriptedPerceiver, every_moment, make_step, on_axis, pipeline_of
from msgspec.structs import replace

from haptigraph.assemble import load_procedure
from haptigraph.clock import VirtualClock
from haptigraph.errors import BadInput, EndOfSource, PerceiverBroken, SourceLost
from haptigraph.geometry import Segment
from haptigraph.messages import Capture, Fault
from haptigraph.pipeline import Loop
from haptigraph.sinks.recorder import Recorder
from haptigraph.stages import Source

IMAGE = np.zeros((4, 4), np.uint8)
PERIOD_NS = 33_333_333


class ListSource(Source):
    """Deliver the items of a list: captures, None (timeout), or exceptions."""

    def __init__(self, items, *, is_live=False, rate_hz=30.0, clock=None):
        self.items, self.is_live, self.rate_hz, self.clock = list(items), is_live, rate_hz, clock
        self.closed = 0

    def read(self, timeout_s):
        if not self.items:
            raise EndOfSource
        item = self.items.pop(0)
        if isinstance(item, BaseException):
            raise item
        if item is None and self.clock is not None:
            self.clock.wait_until(self.clock.now_ns() + round(timeout_s * 1e9))
        return item

    def close(self):
        self.closed += 1


class Memory:
    """A sink and an output that keep everything."""

    dropped = 0

    def __init__(self):
        self.steps, self.captures, self.sent, self.closed = [], [], [], 0
        self.is_silent = True
        self.faults: list[Fault] = []

    def write(self, capture, step):
        self.captures.append(capture)
        self.steps.append(step)

    def send(self, step, now_ns):
        self.sent.append((step, now_ns))

    def take_faults(self):
        faults, self.faults = tuple(self.faults), []
        return faults

    def close(self):
        self.closed += 1


def captures(count, start=0):
    return [Capture(n, n * PERIOD_NS, IMAGE) for n in range(start, start + count)]


@pytest.fixture
def tips(registration):
    """A script: misaligned far away, misaligned near, aligned near, on the target, lost."""
    anatomy = registration.anatomy
    poses = [(8.0, 5.0), (20.0, 5.0), (20.0, 0.0), (22.9, 0.0)]
    return [*(on_axis(anatomy, *pose) for pose in poses), None]


def loop_of(pipeline, source, **options):
    output, sink = Memory(), Memory()
    clock = options.pop("clock", VirtualClock())
    return Loop(pipeline, source=source, output=output, sinks=[sink], clock=clock, **options), output, sink


def states(sink):
    return [step.conclusion.state for step in sink.steps]


def test_a_run_passes_through_states_and_patterns(procedure, registration, tips):
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, tips))
    loop, output, sink = loop_of(pipeline, ListSource(captures(5)))
    report = loop.run()
    assert states(sink) == [
        "misaligned_intraocular_navigation",
        "misaligned_retinal_approach",
        "aligned_retinal_approach",
        "target_hit",
        "unknown",
        "unknown",  # the source ended
    ]
    assert [step.command.pattern.name for step in sink.steps] == [
        "low",
        "low",
        "off",
        "success",
        "off",
        "off",
    ]
    assert report.steps == 6
    assert report.ended == "source ended"
    assert report.duration_s == pytest.approx(5 / 30)
    assert [step.index for step in sink.steps] == [0, 1, 2, 3, 4, 4]
    assert [step for step, _ in output.sent] == [replace(step, timing=None) for step in sink.steps]


def test_a_tip_that_is_no_longer_visible_ends_every_pattern_and_comes_back(procedure, registration, tips):
    trocar, at_target = registration.anatomy["trocar"].at_mm, tips[3]
    shaft = Segment(trocar, on_axis(registration.anatomy, 20.0))
    script = [at_target, shaft, at_target, None]
    loop, _, sink = loop_of(
        pipeline_of(procedure, ScriptedPerceiver(registration, script)), ListSource(captures(4))
    )
    loop.run()
    assert states(sink)[:4] == ["target_hit", "tip_not_visible", "target_hit", "unknown"]
    assert [step.command.pattern.name for step in sink.steps][:4] == ["success", "off", "success", "off"]
    assert sink.steps[1].conclusion.because == "the needle is seen, its tip is not"
    assert sink.steps[1].graph.measures == {"theta_deg": pytest.approx(0.0, abs=1e-4)}


def test_the_steady_variant_makes_a_tip_that_is_not_visible_felt(registration, tips):
    shaft = Segment(registration.anatomy["trocar"].at_mm, tips[0])
    steady = load_procedure("subretinal_injection_steady")
    loop, _, sink = loop_of(
        pipeline_of(steady, ScriptedPerceiver(registration, [tips[0], shaft, None])), ListSource(captures(3))
    )
    loop.run()
    assert [step.command.pattern.name for step in sink.steps][:3] == ["low", "tick", "off"]


def test_the_same_captures_give_the_same_steps(procedure, registration, tips):
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, tips))
    first = [pipeline.step(capture) for capture in captures(20)]
    pipeline.reset()
    assert [pipeline.step(capture) for capture in captures(20)] == first


def test_every_step_is_stamped_on_the_runs_clock_in_order(procedure, registration, tips):
    clock = VirtualClock(start_ns=5_000_000_000)
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, tips))
    loop, _, sink = loop_of(pipeline, ListSource(captures(4)), clock=clock)
    loop.run()
    stamps = [step.stamp_ns for step in sink.steps]
    assert stamps[:2] == [5_000_000_000, 5_000_000_000 + PERIOD_NS]
    for step in sink.steps:
        assert step.stamp_ns <= step.timing.processed_ns <= step.timing.commanded_ns
        assert {"perceive", "build_scene", "reason", "render", "step"} <= set(step.timing.stage_ns)


def test_the_end_of_a_source_is_a_step_and_closes_everything(procedure, registration, tips):
    source = ListSource(captures(2))
    loop, output, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    loop.run()
    assert sink.steps[-1].faults == ()  # a normal end is no fault
    assert sink.captures[-1].image is None
    assert not loop.report.faults
    assert (source.closed, output.closed, sink.closed) == (1, 1, 1)


def test_a_stale_image_is_unknown_and_silent(procedure, registration, tips):
    clock = VirtualClock()
    source = ListSource([*captures(1), None, None, *captures(1, start=1)], is_live=True, clock=clock)
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, [tips[0]]))
    loop, _, sink = loop_of(pipeline, source, clock=clock, stale_ms=100)
    loop.run()
    assert states(sink)[:4] == ["misaligned_intraocular_navigation", "unknown", "unknown", states(sink)[0]]
    assert sink.steps[1].faults == (Fault("source", "stale image: none for 100 ms"),)
    assert sink.steps[1].command.pattern.name == "off"
    assert sink.steps[2].stamp_ns - sink.steps[1].stamp_ns == 100 * MS


def test_a_late_image_does_not_decrease_the_stamps(procedure, registration, tips):
    clock = VirtualClock()
    late = [Capture(0, 10 * MS, IMAGE), None, Capture(1, 60 * MS, IMAGE), Capture(2, 120 * MS, IMAGE)]
    source = ListSource(late, is_live=True, clock=clock)
    loop, _, sink = loop_of(
        pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source, clock=clock
    )
    loop.run()
    assert [step.stamp_ns for step in sink.steps[:4]] == [10 * MS, 100 * MS, 100 * MS, 120 * MS]


def test_a_lost_camera_is_a_fault_and_the_loop_goes_on(procedure, registration, tips):
    source = ListSource([*captures(1), SourceLost("camera:0 is gone"), *captures(1, 1)], is_live=True)
    loop, _, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, [tips[0]])), source)
    loop.run()
    assert sink.steps[1].faults == (Fault("source", "camera:0 is gone"),)
    assert states(sink)[1:3] == ["unknown", "misaligned_intraocular_navigation"]


def test_a_raising_perceiver_is_a_fault_the_state_unknown_and_is_reset(procedure, registration, tips):
    perceiver = ScriptedPerceiver(registration, [tips[0], ValueError("singular"), tips[0]])
    loop, _, sink = loop_of(pipeline_of(procedure, perceiver), ListSource(captures(3)))
    loop.run()
    assert states(sink)[:3] == ["misaligned_intraocular_navigation", "unknown", states(sink)[0]]
    assert sink.steps[1].faults == (Fault("perceiver", "ValueError: singular"),)
    assert perceiver.resets >= 1


def test_three_failures_in_a_row_stop_the_run_with_the_reason(procedure, registration, tips):
    error = ZeroDivisionError("no light")
    perceiver = ScriptedPerceiver(registration, [error, error, tips[0], error, error, error, tips[0]])
    loop, output, sink = loop_of(pipeline_of(procedure, perceiver), ListSource(captures(7)))
    with pytest.raises(PerceiverBroken, match="3 images in a row: ZeroDivisionError: no light"):
        loop.run()
    assert len(sink.steps) == 6
    assert (output.closed, sink.closed) == (1, 1)


def test_an_error_of_the_user_ends_the_run(procedure, registration):
    perceiver = ScriptedPerceiver(registration, [BadInput("image is 3 x 3 px")])
    loop, output, _ = loop_of(pipeline_of(procedure, perceiver), ListSource(captures(1)))
    with pytest.raises(BadInput):
        loop.run()
    assert output.closed == 1


def test_ctrl_c_ends_cleanly(procedure, registration, tips):
    source = ListSource([*captures(2), KeyboardInterrupt(), *captures(2)])
    loop, output, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    report = loop.run()
    assert report.ended == "interrupted"
    assert (len(sink.steps), output.closed, sink.closed, source.closed) == (2, 1, 1, 1)


def test_faults_of_output_and_sinks_are_in_the_next_step(procedure, registration, tips):
    loop, output, sink = loop_of(
        pipeline_of(procedure, ScriptedPerceiver(registration, tips)), ListSource(captures(2))
    )
    output.faults.append(Fault("device", "unplugged"))
    steps = loop.steps()
    assert next(steps).faults == (Fault("device", "unplugged"),)
    sink.faults.append(Fault("recorder", "disk full"))
    assert next(steps).faults == (Fault("recorder", "disk full"),)
    steps.close()
    assert output.closed == 1
    assert loop.report.faults == {"device: unplugged": 1, "recorder: disk full": 1}


def test_what_was_output_is_recorded_once_whenever_ctrl_c_comes():
    pipeline = SimpleNamespace(stage_ns={}, step=lambda capture: make_step(stamp_ns=capture.stamp_ns))
    for pressing_ctrl_c in every_moment():
        output, writer = Memory(), Mock(take_problems=tuple)
        sinks = [Memory(), Recorder(writer, waits=True)]
        loop = Loop(pipeline, source=ListSource([]), output=output, sinks=sinks, clock=VirtualClock())
        first, second = captures(2)
        loop._process(first)
        pressing_ctrl_c(partial(loop._process, second))
        loop.close()
        written = [each.args[1].stamp_ns for each in writer.write.call_args_list]
        assert written in ([0], [0, PERIOD_NS])
        assert {step.stamp_ns for step, _ in output.sent} <= set(written)


class SlowClock(VirtualClock):
    """A clock that advances at every reading."""

    def __init__(self, cost_ns):
        super().__init__()
        self._cost_ns = cost_ns

    def now_ns(self):
        self._now_ns += self._cost_ns
        return self._now_ns


@pytest.mark.parametrize("at", ["read", "perceive"])
def test_a_fault_just_before_ctrl_c_is_in_the_report(procedure, registration, tips, at):
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, tips))
    if at == "perceive":
        pipeline.perceive = Mock(side_effect=KeyboardInterrupt)
    items = [KeyboardInterrupt()] if at == "read" else captures(1)
    loop, _, sink = loop_of(pipeline, ListSource(items))
    sink.faults.append(Fault("recorder", "run.mcap is incomplete"))
    assert loop.run().faults == {"recorder: run.mcap is incomplete": 1}


def test_a_loop_that_is_late_counts_overruns_and_never_runs_backwards(procedure, registration, tips):
    pipeline = pipeline_of(procedure, ScriptedPerceiver(registration, tips))
    loop, _, sink = loop_of(pipeline, ListSource(captures(20)), clock=SlowClock(20 * MS))
    report = loop.run()
    assert report.overruns == 19  # three readings an image are 60 ms, an image is 33 ms
    stamps = [step.stamp_ns for step in sink.steps]
    assert stamps == sorted(stamps)


def test_skipped_images_of_a_live_source_are_counted(procedure, registration, tips):
    source = ListSource([*captures(1), *captures(1, start=4)], is_live=True)
    loop, _, _ = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    assert loop.run().skipped == 3


def test_a_loop_that_never_ran_can_be_closed(procedure, registration, tips):
    source = ListSource(captures(2))
    loop, output, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    loop.close()
    loop.close()
    assert (source.closed, output.closed, sink.closed) == (1, 1, 1)


@pytest.mark.parametrize("is_silent", [True, False])
def test_a_report_says_whether_the_output_is_silent(procedure, registration, tips, is_silent):
    source = ListSource(captures(2))
    loop, output, _ = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    output.is_silent = is_silent
    assert not loop.report.is_silent
    loop.run()
    assert loop.report.is_silent is is_silent


def test_everything_is_closed_even_if_one_of_them_raises(procedure, registration, tips):
    class Stuck(ListSource):
        def close(self):
            super().close()
            raise KeyboardInterrupt

    source = Stuck(captures(2))
    loop, output, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    with pytest.raises(KeyboardInterrupt):
        loop.close()
    assert (source.closed, output.closed, sink.closed) == (1, 1, 1)


def test_an_interrupted_silencing_is_repeated(procedure, registration, tips):
    source = ListSource(captures(2))
    loop, output, sink = loop_of(pipeline_of(procedure, ScriptedPerceiver(registration, tips)), source)
    close = output.close
    output.close = Mock(side_effect=KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        loop.close()
    assert (source.closed, output.closed, sink.closed) == (1, 0, 1)
    output.close = close
    loop.close()
    loop.close()
    assert (source.closed, output.closed, sink.closed) == (1, 1, 1)


def test_an_unusable_image_is_named(procedure, registration, tips):
    perceiver = ScriptedPerceiver(registration, [tips[0], BadInput("image is too small")])
    loop, _, _ = loop_of(pipeline_of(procedure, perceiver), ListSource(captures(5)))
    with pytest.raises(BadInput, match=r"^image 1: image is too small$"):
        list(loop.steps())
    assert loop.report.steps == 1
