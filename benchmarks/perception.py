"""Speed of perception compared with a plain OpenCV implementation of the paper's: one thread, equal images.

Images come from the simulator, or from a labelled clip: `python benchmarks/perception.py CLIP_DIR`. First all
candidates process each image before the next one, so that other load affects all of them equally. Then each
processes all images alone, as in a run, where its caches stay warm.
"""

import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from itertools import islice, product
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, load_config
from haptigraph.messages import Capture, Image
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.sources.reading import read_images

SIMULATED = "phantom:align_then_approach"
IMAGES = 300
PASSES = 3
BLOCK_PX, OFFSET_GREY = 51, 10
PLAIN = "plain OpenCV"


class PlainOpenCV:
    """A straightforward implementation of the paper's pipeline (section II-B) on the full image."""

    def __init__(self, registration: Registration) -> None:
        image = registration.image
        center = tuple(round(value) for value in image.center_px)
        radius_px = round(registration.globe.radius_mm / image.mm_per_px)
        self._mask = np.zeros((registration.height_px, registration.width_px), np.uint8)
        cv2.circle(self._mask, center, radius_px, 255, cv2.FILLED)

    def __call__(self, image: Image) -> object:
        """Return the line of `cv2.fitLine` through the largest dark blob inside the globe."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        dark = cv2.adaptiveThreshold(
            grey, 255, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY_INV, BLOCK_PX, OFFSET_GREY
        )
        dark = cv2.bitwise_and(dark, self._mask)
        contours, _ = cv2.findContours(dark, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if not contours:
            return None
        return cv2.fitLine(max(contours, key=cv2.contourArea), cv2.DIST_L2, 0, 0.01, 0.01)


def load(folder: Path | None) -> tuple[Registration, list[Capture]]:
    """Return registration and images of a clip, or of the simulator."""
    uri = str(folder / "clip.mp4") if folder else SIMULATED
    config = load_config(None, (f'source.uri="{uri}"', "source.jpeg_quality=0"))
    source = assemble.open_source(config, VirtualClock())
    if folder:
        registration = load_registration(folder / "registration.toml")
    else:
        registration = parse_registration(source.registration or "", uri)
    with closing(read_images(source)) as images:
        captures = [replace(capture, encoded=None) for capture in islice(images, IMAGES)]
    return registration, captures


def candidates(registration: Registration) -> dict[str, Callable[[Capture], object]]:
    """Return the measured functions by name, the plain pipeline first."""
    plain = PlainOpenCV(registration)
    procedure = assemble.load_procedure("subretinal_injection")
    pipelines = {
        name: assemble.build_pipeline(load_config().with_perceiver(name), registration, procedure)
        for name in ("tracker", "forceps", "threshold")
    }
    default = assemble.perceiver_name(Config(), procedure)
    step = assemble.build_pipeline(load_config(), registration, procedure).step
    return {
        PLAIN: lambda capture: plain(capture.image),
        **{name: pipeline.perceive for name, pipeline in pipelines.items()},
        f"step ({default})": step,
    }


def timed(
    measured: dict[str, Callable[[Capture], object]], order: Callable[[], Iterable[tuple[str, Capture]]]
) -> dict[str, list[float]]:
    """Return the times per candidate and image [ms]; the first pass warms up."""
    took_ms: dict[str, list[float]] = {name: [] for name in measured}
    for turn in range(PASSES + 1):
        for name, capture in order():
            start_ns = time.perf_counter_ns()
            measured[name](capture)
            if turn:
                took_ms[name].append((time.perf_counter_ns() - start_ns) / 1e6)
    return took_ms


def print_times(title: str, took_ms: dict[str, list[float]]) -> None:
    """Print percentiles, and the plain pipeline's median relative to them."""
    print(f"{title:20}{'p50':>9}{'p99':>12}{'plain p50 / p50':>20}{'plain p50 / p99':>18}")
    plain_ms = float(np.median(took_ms[PLAIN]))
    for name, times_ms in took_ms.items():
        p50, p99 = np.percentile(times_ms, (50, 99))
        print(f"{name:20}{p50:6.3f} ms{p99:9.3f} ms{plain_ms / p50:20.2f}{plain_ms / p99:18.2f}")


def main() -> None:
    """Measure and print."""
    cv2.setNumThreads(1)
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    registration, captures = load(folder)
    measured = candidates(registration)
    print(f"{PASSES} x {len(captures)} images of {folder.name if folder else SIMULATED}, one thread")
    interleaved = timed(measured, lambda: ((name, image) for image in captures for name in measured))
    print_times("interleaved", interleaved)
    print_times("separately", timed(measured, lambda: product(measured, captures)))


if __name__ == "__main__":
    main()
