"""Speed of the loop: steps/s and the time of every stage, on one thread with images decoded beforehand.

`python benchmarks/loop.py [--steps N] [--paced N]` also times N steps at full speed, and N at 30 images/s:
once asleep until each image is due, as the loop is, and once awake. What only the first of the two has is due
to waking up: a processor that slept, and caches that others used. The thread's own time leaves out what other
processes take from it. Uses the labelled clip A_easy if it exists beside the checkout, otherwise the
simulated phantom.
"""

import argparse
import resource
import time
from collections.abc import Callable
from contextlib import closing
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.messages import Capture
from haptigraph.pipeline import Pipeline
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.run_report import Durations
from haptigraph.sources.reading import read_images

CLIP = Path(__file__).parents[2] / "shared" / "clips" / "A_easy"
IMAGES = 300
PASSES = 5
STEPS, PACED = 0, 0
PERIOD_NS = 33_333_333
HEAD = "steps    time       p50       p99     p99.9       max  faults/step   preempted"
SCENARIOS = {"membrane_peeling": "membrane_peeling", "subretinal_injection_ioct": "ioct_approach"}
"""By procedure that the clip does not show."""

STAGES = ("perceive", "build_scene", "reason", "render", "step")


def load(procedure: str = "subretinal_injection") -> tuple[str, Pipeline, list[Capture]]:
    """Return the name of the source, a pipeline, and its captures."""
    if procedure in SCENARIOS:
        uri = f"phantom:{SCENARIOS[procedure]}"
    elif CLIP.is_dir():
        registration = load_registration(CLIP / "registration.toml")
        uri = str(CLIP / "clip.mp4")
    else:
        uri = "phantom:align_then_approach"
    config = load_config(None, (f'source.uri="{uri}"',))
    source = assemble.open_source(config, VirtualClock())
    if source.registration is not None:
        registration = parse_registration(source.registration, uri)
    with closing(read_images(source)) as images:
        captures = [replace(capture, encoded=None) for capture in islice(images, IMAGES)]
    pipeline = assemble.build_pipeline(config, registration, assemble.load_procedure(procedure))
    return uri, pipeline, captures


def asleep(due_ns: int) -> None:
    """Sleep until a time."""
    while (left_ns := due_ns - time.perf_counter_ns()) > 0:
        time.sleep(left_ns / 1e9)


def awake(due_ns: int) -> None:
    """Do nothing until a time, without sleeping."""
    while time.perf_counter_ns() < due_ns:
        pass


def at_once(_due_ns: int) -> None:
    """Do not wait."""


def print_paced(
    name: str, pipeline: Pipeline, captures: list[Capture], steps: int, wait: Callable[[int], None]
) -> None:
    """Time steps that each begin when `wait` returns, and print percentiles and what interrupted them."""
    pipeline.reset()
    took_ms, own_ms = np.empty((2, steps))
    before, due_ns = resource.getrusage(resource.RUSAGE_THREAD), time.perf_counter_ns()
    for number, capture in enumerate(islice(cycle(captures), steps)):
        due_ns += PERIOD_NS
        wait(due_ns)
        start_ns, own_ns = time.perf_counter_ns(), time.thread_time_ns()
        pipeline.step(replace(capture, index=number, stamp_ns=number * PERIOD_NS))
        own_ms[number] = (time.thread_time_ns() - own_ns) / 1e6
        took_ms[number] = (time.perf_counter_ns() - start_ns) / 1e6
    after = resource.getrusage(resource.RUSAGE_THREAD)
    faults = (after.ru_minflt - before.ru_minflt) / steps
    preempted = (after.ru_nivcsw - before.ru_nivcsw) / steps
    for times, each_ms in (("passed", took_ms), ("own", own_ms)):
        values = *np.percentile(each_ms, (50, 99, 99.9)), each_ms.max()
        figures = "".join(f"{value:10.3f}" for value in values)
        print(f"{name:14}{steps:8}{times:>8}{figures}{faults:14.2f}{preempted:12.3f}", flush=True)


def main() -> None:
    """Parse the arguments, measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/loop.py --steps 100000 --paced 3000",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--steps", type=int, default=STEPS, metavar="N", help="steps at full speed")
    parser.add_argument("--paced", type=int, default=PACED, metavar="N", help="steps at 30 images/s")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    uri, pipeline, captures = load()
    print_stages(uri, pipeline, captures)
    if given.steps or given.paced:
        print(f"\n{'step [ms]':17}{HEAD}")
    if given.steps:
        print_paced("full speed", pipeline, captures, given.steps, at_once)
    if given.paced:
        print_paced("paced, awake", pipeline, captures, given.paced, awake)
        print_paced("paced, asleep", pipeline, captures, given.paced, asleep)


def print_stages(uri: str, pipeline: Pipeline, captures: list[Capture]) -> None:
    """Print steps/s and the time of every stage."""
    for capture in captures:
        pipeline.step(capture)  # warm up
    durations = {name: Durations() for name in STAGES}
    start_ns = time.perf_counter_ns()
    for _ in range(PASSES):
        pipeline.reset()
        for capture in captures:
            step_ns = time.perf_counter_ns()
            pipeline.step(capture)
            durations["step"].add(time.perf_counter_ns() - step_ns)
            for name in STAGES[:-1]:
                durations[name].add(pipeline.stage_ns[name])
    seconds = (time.perf_counter_ns() - start_ns) / 1e9
    count = PASSES * len(captures)
    print(f"{count} steps on {Path(uri).name if CLIP.is_dir() else uri}: {count / seconds:.0f} steps/s")
    print(f"{'stage':14}{'p50':>10}{'p99':>13}{'share':>9}")
    total_ms = durations["step"].percentile_ms(50)
    for name in STAGES:
        p50, p99 = durations[name].percentile_ms(50), durations[name].percentile_ms(99)
        print(f"{name:14}{p50:7.3f} ms{p99:10.3f} ms{100 * p50 / total_ms:8.1f}%")


if __name__ == "__main__":
    main()
