"""Speed of the loop: steps/s and the time of every stage, on one thread with images decoded beforehand.

Uses the labelled clip A_easy if it exists beside the checkout, otherwise the simulated phantom.
"""

import time
from contextlib import closing
from itertools import islice
from pathlib import Path

import cv2
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


def main() -> None:
    """Measure and print."""
    cv2.setNumThreads(1)
    uri, pipeline, captures = load()
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
