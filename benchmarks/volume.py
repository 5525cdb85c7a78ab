"""Speed and accuracy of surfaces and needle in simulated OCT volumes with ground truth.

`python benchmarks/volume.py speed`: time per volume of 256 x 48 x 192 voxels, one thread. `accuracy [N]
[--seed S] [--any-roll]`: errors of tip, axis, gap above the RPE, ILM and RPE over N random volumes, a sixth
of them without a needle, and whether the standard deviations are true. `--any-roll`: the bevel faces any
side, not up or down.
"""

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec.structs import replace
from volume_gap import gap_to

from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft import FoundNeedle, VolumeFindings, find_needle_and_surfaces
from haptigraph.perception.volume.surfaces import HeightMap
from haptigraph.sim.oct.volumes.scenes import VolumeScene, random_volume_scene
from haptigraph.sim.oct.volumes.volume import Volume, VolumeTruth

VOLUMES, PASSES, SEED = 12, 3, 101
MARGIN_MM = 0.07  # surfaces closer to the upper or lower border are excluded
GROSS_UM = 100.0


def scenes(count: int, seed: int, any_roll: bool) -> Iterator[VolumeScene]:
    """Yield random scenes."""
    for number in range(count):
        scene = random_volume_scene(number, seed)
        if any_roll:
            roll_deg = float(np.random.default_rng((seed, 41, number)).uniform(-180, 180))
            scene = replace(scene, needle=replace(scene.needle, roll_deg=roll_deg))
        yield scene


def found_in(volume: Volume) -> VolumeFindings:
    """Return what is found in a volume."""
    grid = volume.truth.grid
    scale = VolumeScale(*grid.shape, *grid.voxel_mm)
    return find_needle_and_surfaces(volume.image.reshape(scale.shape), scale)


def speed() -> None:
    """Print the time per volume."""
    volumes = [scene.take() for scene in scenes(VOLUMES, SEED, False)]
    took_ms: dict[str, list[float]] = {"wall": [], "CPU": []}
    for turn in range(PASSES + 1):
        for volume in volumes:
            start_ns = time.perf_counter_ns(), time.thread_time_ns()
            found_in(volume)
            end_ns = time.perf_counter_ns(), time.thread_time_ns()
            if turn:  # the first pass warms up
                for name, start, end in zip(took_ms, start_ns, end_ns, strict=True):
                    took_ms[name].append((end - start) / 1e6)
    print(f"{PASSES} x {VOLUMES} volumes of 256 x 48 x 192 voxels, one thread")
    for name, times_ms in took_ms.items():  # they differ on a busy machine
        p50, p95 = np.percentile(times_ms, (50, 95))
        print(f"{name:5} p50 {p50:.0f} ms   p95 {p95:.0f} ms   least {min(times_ms):.0f} ms")


class Errors:
    """Errors over many volumes."""

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = defaultdict(list)
        self.count: dict[str, int] = defaultdict(int)

    def add(self, volume: Volume) -> None:
        """Add those of one volume."""
        found, truth = found_in(volume), volume.truth
        for name in ("ilm", "rpe"):
            self._add_surface(name, getattr(found, name), truth)
        needle, true = found.needle, truth.needle
        if true is None or not truth.grid.contains(true.tip_mm):
            self.count["no needle"] += true is None
            self.count["false needle"] += true is None and needle is not None
            return
        self.count["needle"] += 1
        self.count["found"] += needle is not None
        if needle is not None:
            angle_deg = math.degrees(math.acos(min(float(needle.along @ true.along), 1.0)))
            self.of["axis_deg"].append(angle_deg)
            self.of["axis_z"].append(angle_deg / needle.direction_sd_deg / math.sqrt(2))
            self._add_tip(needle, found.rpe, truth)

    def _add_tip(self, needle: FoundNeedle, rpe: HeightMap, truth: VolumeTruth) -> None:
        if needle.tip_mm is None or truth.needle is None:
            return
        self.count["tip"] += 1
        off_mm = needle.tip_mm - truth.needle.tip_mm
        self.of["tip_um"].append(1e3 * float(np.linalg.norm(off_mm)))
        self.of["tip_z"] += np.abs(off_mm / needle.tip_sd_mm).tolist()
        self.count["gross"] += self.of["tip_um"][-1] > GROSS_UM
        if rpe.visible.any():
            gap = gap_to(rpe, needle.tip_mm, needle.tip_cov_mm2)
            gap_mm = gap.gap_mm - truth.gap_mm
            self.of["gap_um"].append(1e3 * abs(gap_mm))
            self.of["signed_gap_um"].append(1e3 * gap_mm)
            self.of["gap_z"].append(abs(gap_mm) / gap.sd_mm)
        if needle.facing is not None:
            self.count["bevel stated"] += 1
            self.count["bevel wrong"] += float(needle.facing @ truth.needle.facing) < 0.5

    def _add_surface(self, name: str, surface: HeightMap, truth: VolumeTruth) -> None:
        x_mm = truth.grid.x_mm
        true, lit = (
            np.stack([np.interp(surface.x_mm, x_mm, row) for row in array.astype(float)])
            for array in (getattr(truth, f"{name}_mm"), getattr(truth, f"{name}_lit"))
        )
        inside = np.abs(true) < truth.grid.y_mm[0] - MARGIN_MM
        off_mm = np.abs(surface.height_mm - true)
        for kind, cells in (
            ("", inside & (lit > 0.99) & surface.visible),
            (" hidden", inside & (lit < 0.01)),
        ):
            self.of[f"{name}{kind}_um"] += (1e3 * off_mm[cells]).tolist()
            self.of[f"{name}{kind}_z"] += (off_mm / surface.sd_mm)[cells].tolist()
        self.count[f"{name} lit"] += int((inside & (lit > 0.99)).sum())
        self.count[f"{name} visible"] += int((inside & (lit > 0.99) & surface.visible).sum())
        self.count[f"{name} dark"] += int((lit < 0.01).sum())
        self.count[f"{name} false"] += int(((lit < 0.01) & surface.visible).sum())


def accuracy(count: int, seed: int, any_roll: bool) -> None:
    """Print median and 95th percentile of the errors, and quantiles of |error| / sd."""
    errors = Errors()
    for scene in scenes(count, seed, any_roll):
        errors.add(scene.take())
    tally, of = errors.count, errors.of
    print(
        f"{tally['needle']} volumes with a needle: found in {tally['found']}, with tip in {tally['tip']}; "
        f"more than {GROSS_UM:.0f} µm off: {tally['gross']}"
    )
    print(f"{tally['no needle']} volumes without: a needle in {tally['false needle']}")
    print(f"side of the bevel stated in {tally['bevel stated']}, wrong in {tally['bevel wrong']}")
    print(f"gap: median of the signed error {np.median(of['signed_gap_um'] or [math.nan]):+.1f} µm")
    names = ("tip_um", "gap_um", "axis_deg", "ilm_um", "ilm hidden_um", "rpe_um", "rpe hidden_um")
    for name in names:
        values, z = of[name] or [math.nan], of[f"{name.rpartition('_')[0]}_z"] or [math.nan]
        median, p95 = np.percentile(values, (50, 95))
        p68, p954, p997 = np.percentile(z, (68.3, 95.4, 99.7))
        spread = f"{p68:.2f}  {p954:.2f}  {p997:.2f}"
        print(f"{name:14} median {median:6.2f}  95 % {p95:6.2f}   |error| / sd: {spread}")
    for name in ("ilm", "rpe"):
        shown, false = (
            100 * tally[f"{name} {one}"] / max(tally[f"{name} {all_}"], 1)
            for one, all_ in (("visible", "lit"), ("false", "dark"))
        )
        print(f"{name}: reported as visible in {shown:.1f} % of lit cells and {false:.1f} % of dark ones")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("speed", "accuracy"))
    parser.add_argument("volumes", nargs="?", type=int, default=240)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--any-roll", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.what == "speed":
        speed()
    else:
        accuracy(options.volumes, options.seed, options.any_roll)


if __name__ == "__main__":
    main()
