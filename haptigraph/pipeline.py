"""The main loop: `Pipeline.step` turns one capture into a step, `Loop.run` repeats it until the source ends.

`step` is deterministic: the same captures give the same steps, bit for bit. `run` paces, stamps, counts and
reports; anything that goes wrong becomes a fault in a step. Stages are known by their Protocols only.
"""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack
from typing import Protocol, TypeVar

from msgspec.structs import replace

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, EndOfSource, HaptigraphError, PerceiverBroken, SourceLost
from haptigraph.haptics.observed_device import DeliveryLog
from haptigraph.messages import STALE_IMAGE, Capture, Fault, Observation, Step, Timing
from haptigraph.run_report import RunReport
from haptigraph.sources.timing import moved_in_time
from haptigraph.stages import (
    ForceReadings,
    Perceiver,
    Reasoner,
    Renderer,
    RobotReadings,
    SceneBuilder,
    Sink,
    Source,
)

__all__ = ["HapticOutput", "Loop", "Pipeline"]

MAX_PERCEIVER_FAULTS = 3  # in a row

Input = TypeVar("Input", contravariant=True)
Output = TypeVar("Output", covariant=True)


class HapticOutput(Protocol):
    """Receives the commands: the guard, alone or driven by its player."""

    @property
    def is_silent(self) -> bool:
        """Whether it is closed, and the actuator raised no doubt that it is silent."""
        ...

    def send(self, step: Step, now_ns: int) -> None:
        """Take the newest step."""
        ...

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        ...

    def close(self) -> None:
        """Silence the actuator for good."""
        ...


class Pipeline:
    """The four stages from an image to a haptic command.

    Args:
        perceive: Image -> observation.
        build_scene: Observation -> scene graph.
        reason: Scene graph -> conclusion.
        render: Conclusion -> haptic command.
    """

    def __init__(
        self, *, perceive: Perceiver, build_scene: SceneBuilder, reason: Reasoner, render: Renderer
    ) -> None:
        self.stage_ns: dict[str, int] = {}
        """Duration of each stage in the last step."""
        self._perceiver = perceive
        self._stages = (perceive, build_scene, reason, render)
        self.perceive = self._timed("perceive", self._perceive)
        self.build_scene = self._timed("build_scene", build_scene)
        self.reason = self._timed("reason", reason)
        self.render = self._timed("render", render)

    def step(self, capture: Capture) -> Step:
        """Turn one capture into one step."""
        observation = self.perceive(capture)  # image (px) -> positions (eye frame, mm), with uncertainty
        graph = self.build_scene(observation)  # -> which relations hold
        conclusion = self.reason(graph)  # -> surgical state, the rule that fired, why
        command = self.render(conclusion)  # -> haptic pattern
        return Step(capture.index, capture.stamp_ns, observation, graph, conclusion, command)

    def reset(self) -> None:
        """Forget all earlier captures."""
        for stage in self._stages:
            stage.reset()

    def _perceive(self, capture: Capture) -> Observation:
        """Perceive one image; observe nothing if there is no image or the perceiver raises."""
        faults = capture.faults
        if capture.image is not None:
            try:
                observation = self._perceiver(capture)
                return replace(observation, faults=(*faults, *observation.faults)) if faults else observation
            except BadInput as error:
                raise BadInput(error.problem, error.file, f"image {capture.index}") from None
            except HaptigraphError:
                raise
            except Exception as error:  # a perceiver may be third-party code
                faults = (*faults, Fault("perceiver", f"{type(error).__name__}: {error}"))
        self._perceiver.reset()
        return Observation(capture.stamp_ns, {}, faults)

    def _timed(self, name: str, stage: Callable[[Input], Output]) -> Callable[[Input], Output]:
        def timed(message: Input) -> Output:
            begun_ns = time.perf_counter_ns()
            result = stage(message)
            self.stage_ns[name] = time.perf_counter_ns() - begun_ns
            return result

        return timed


class Loop:
    """One assembled system, from the source to the haptic output.

    Args:
        pipeline: The stages.
        source: Delivers the captures.
        output: Receives the commands.
        sinks: Receive every step.
        clock: The run's clock; with a virtual one the loop runs as fast as it can.
        stale_ms: Without a new image for so long, the needle counts as lost.
        deliveries: Takes the vibration that outputs confirm, until the next capture.
        robot: Takes the robot's measurements, until the next capture; None: there is no robot.
        force: Takes what the force device did, until the next capture; None: there is none.
        notes: What the user should know before the run, a sentence each.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        *,
        source: Source,
        output: HapticOutput,
        sinks: Sequence[Sink] = (),
        clock: Clock,
        stale_ms: float = 100.0,
        deliveries: DeliveryLog | None = None,
        robot: RobotReadings | None = None,
        force: ForceReadings | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        self.pipeline, self.source, self.output, self.sinks = pipeline, source, output, tuple(sinks)
        self.notes, self.report = tuple(notes), RunReport()
        self.deliveries = deliveries or DeliveryLog()
        self._clock, self._stale_ms, self.robot, self._force = clock, stale_ms, robot, force
        self._start_ns: int | None = None
        self._last_ns: int | None = None
        self._index = -1
        self._output_closed = self._closed = False
        self._uncounted: tuple[Fault, ...] = ()  # taken, but in no step yet: Ctrl-C may come before it
        self._unrecorded: tuple[Capture, Step] | None = None  # Ctrl-C may come as soon as it is felt

    def run(self) -> RunReport:
        """Run until the source ends or Ctrl-C, and return the report. See `steps`."""
        try:
            for _ in self.steps():
                pass
        except KeyboardInterrupt:
            self.report.ended = "interrupted"
        finally:
            self.close()
        return self.report

    def steps(self) -> Generator[Step, None, None]:
        """Yield every step, after its output and recording, until the source ends.

        However it ends, the actuator is silenced and everything closed.

        Raises:
            PerceiverBroken: If perception failed on three images in a row.
            HaptigraphError: If the source's images cannot be used.
        """
        begun_s, first_ns, broken_in_row = time.perf_counter(), None, 0
        try:
            for capture in self._captures():
                step = self._process(self._in_order(capture))
                first_ns = step.stamp_ns if first_ns is None else first_ns
                self.report.steps += 1
                self.report.duration_s = (step.stamp_ns - first_ns) / 1e9
                self.report.wall_s = time.perf_counter() - begun_s
                failed = "perceiver" in [fault.where for fault in step.faults]
                broken_in_row = broken_in_row + 1 if failed else 0
                if broken_in_row == MAX_PERCEIVER_FAULTS:
                    raise PerceiverBroken(
                        f"perception failed on {broken_in_row} images in a row: {step.faults[-1].message}"
                    )
                yield step
        finally:
            self.close()

    def close(self) -> None:
        """Silence the actuator and close everything, whether the loop ran or not. May be called twice."""
        try:
            if not self._output_closed:
                self.report.force = self._force.summary() if self._force else ""
                self.output.close()
                self._output_closed = True  # not if Ctrl-C interrupted it
                self.report.is_silent = self.output.is_silent
        finally:
            self._close_others()

    def _close_others(self) -> None:
        if self._closed:
            return
        self._closed = True
        with ExitStack() as stack:  # closes all of them, whatever one raises
            stack.callback(lambda: self._count((*self._uncounted, *self._take_faults())))
            for sink in reversed(self.sinks):
                stack.callback(self._close_sink, sink)
            stack.callback(self.source.close)
            if self.robot is not None:
                stack.callback(self.robot.close)
            if self._unrecorded is not None:
                stack.callback(self._record, *self._unrecorded)

    def _process(self, capture: Capture) -> Step:
        """Make one step and pass it to the output and the sinks."""
        begun_ns = time.perf_counter_ns()
        step = self.pipeline.step(capture)
        stage_ns = {**self.pipeline.stage_ns, "step": time.perf_counter_ns() - begun_ns}
        processed_ns = self._clock.now_ns()
        self._unrecorded = capture, step
        self.output.send(step, processed_ns)
        step = replace(step, timing=Timing(processed_ns, self._clock.now_ns(), stage_ns))
        self._record(capture, step)
        for name, duration_ns in stage_ns.items():
            self.report.stages[name].add(duration_ns)
        self._count(step.faults)
        self._uncounted = ()
        return step

    def _record(self, capture: Capture, step: Step) -> None:
        self._unrecorded = capture, step
        for sink in self.sinks:
            sink.write(capture, step)
        self._unrecorded = None

    def _captures(self) -> Iterator[Capture]:
        """Yield the source's captures, with the faults outside the stages since the previous one.

        The last one has no image, so that the needle is lost and nothing vibrates; a recording has its own.
        """
        has_ended = False
        while True:
            self._uncounted += self._take_faults()
            faults = self._uncounted
            begun_ns = time.perf_counter_ns()
            lost = f"{STALE_IMAGE}: none for {self._stale_ms:g} ms"
            try:
                capture = self.source.read(self._stale_ms / 1e3)
            except EndOfSource:
                if has_ended:
                    return
                self._clock.wait_until(self._clock.now_ns() + round(1e9 / self.source.rate_hz))
                yield self._without_image("", faults)
                return
            except SourceLost as error:
                capture, lost = None, str(error)
            self.report.stages["read"].add(time.perf_counter_ns() - begun_ns)
            if capture is None:
                yield self._without_image(lost, faults)
                continue
            if not self.source.is_live:
                capture = self._paced(capture)
            self.report.skipped += max(capture.index - self._index - 1, 0)
            self._index = capture.index
            has_ended = capture.image is None and not any(fault.where == "source" for fault in capture.faults)
            yield self._with_readings(
                replace(capture, faults=(*capture.faults, *faults)) if faults else capture
            )

    def _in_order(self, capture: Capture) -> Capture:
        """Keep stamps from decreasing: a late image may have been taken before the moment it was missed."""
        if self._last_ns is not None and capture.stamp_ns < self._last_ns:
            return replace(capture, stamp_ns=self._last_ns)
        self._last_ns = capture.stamp_ns
        return capture

    def _without_image(self, message: str, faults: tuple[Fault, ...]) -> Capture:
        """Make a capture without image, whose step reports the needle as lost, and why, if it is a fault."""
        if message:
            faults = (*faults, Fault("source", message))
        index, now_ns = max(self._index, 0), self._clock.now_ns()
        return self._with_readings(Capture(index, now_ns, None, faults=faults))

    def _with_readings(self, capture: Capture) -> Capture:
        """Add what was measured beside the images since the previous capture."""
        if delivered := self.deliveries.take():
            self.report.add_confirmed(delivered)
            capture = replace(capture, delivered=(*capture.delivered, *delivered))
        if self.robot and (robot := self.robot.take()):
            capture = replace(capture, robot=(*capture.robot, *robot))
        if self._force and (force := self._force.take()):
            capture = replace(capture, force=(*capture.force, *force))
        return capture

    def _paced(self, capture: Capture) -> Capture:
        """Wait until a capture is due and stamp it; the schedule slips when the loop is late."""
        now_ns = self._clock.now_ns()
        if self._start_ns is None:
            self._start_ns = now_ns - capture.stamp_ns
        late_ns = now_ns - self._start_ns - capture.stamp_ns
        if late_ns > 0:
            self.report.add_late(late_ns)
            self._start_ns += late_ns
        due_ns = self._start_ns + capture.stamp_ns
        self._clock.wait_until(due_ns)
        return moved_in_time(capture, due_ns - capture.stamp_ns)

    def _take_faults(self) -> tuple[Fault, ...]:
        of_sinks = [fault for sink in self.sinks for fault in sink.take_faults()]
        of_robot = self.robot.take_faults() if self.robot else ()
        return *self.output.take_faults(), *of_robot, *of_sinks

    def _close_sink(self, sink: Sink) -> None:
        sink.close()
        self.report.dropped += sink.dropped

    def _count(self, faults: Sequence[Fault]) -> None:
        if faults:  # an empty update takes as long as a stage
            self.report.faults.update(str(fault) for fault in faults if not fault.is_over)
