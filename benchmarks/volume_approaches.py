"""Lead time of the alarm before the tip reaches the RPE under OCT volumes, with prediction and without.

`python benchmarks/volume_approaches.py [N] [--images M] [--figure FILE]`. Every approach has its own retina,
needle, speed of 0.1 to 0.4 mm/s, tremor, breathing and heartbeat, until the tip is at the RPE; volumes come
at 4 a second, at a random phase. M approaches are simulated with images and the finder. The N others need no
images: each draws the errors of one of the M, missed tips included. A state is output a latency after its
volume and lasts until the next.
"""

import argparse
import math
from typing import NamedTuple

import cv2
import numpy as np
from volume_gap import gap_to

from haptigraph.imaging import Floats
from haptigraph.perception.volume.ahead import AheadSettings, TipAhead, imaged_ns
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft import VolumeFindings, find_needle_and_surfaces
from haptigraph.perception.volume.surfaces import HeightMap
from haptigraph.sim.oct.volumes.needle import NeedlePose, pose
from haptigraph.sim.oct.volumes.scenes import random_volume_scene
from haptigraph.sim.robot.operator import Tremor

RATE_HZ, LATENCY_S = 4.0, 0.06
SPEED_MM_S = 0.1, 0.4  # along the shaft
ABOVE_MM = 0.3  # start of an approach above the ILM
ALARM_MM = 0.075  # of the measured gap, as in the procedure
FINE = 8  # steps between two volumes, for the time at which the RPE is reached
COARSE = 256, 16, 24  # voxels of a retina without images
SEED = 11
NEIGHBOURS = 8  # errors are drawn from this number of volumes with the most similar gap
VARIANTS = {
    "without prediction": None,
    "predicted, without margin": (0.04, 0.0),
    "predicted, with 1.5 sd": (0.04, 1.5),
    "predicted, as in the procedure": (0.04, 2.0),
}
"""Limit of a predicted gap [mm] and its margin [sd]; None: no prediction. The measured gap counts in all."""
SHOWN = "without prediction", "predicted, as in the procedure"


class Seen(NamedTuple):
    """What is reported of one volume."""

    tip_mm: Floats | None
    tip_sd_mm: Floats
    rpe: HeightMap | None


class Sample(NamedTuple):
    """True gap and errors of one volume with an image."""

    gap_mm: float
    tip_off_mm: Floats | None
    """None: no tip was reported."""
    gap_off_mm: float
    tip_sd_mm: Floats


class Outcome(NamedTuple):
    """The result of one approach under one variant."""

    lead_ms: float
    """From the output of the alarm until the tip is at the RPE; minus infinity: no alarm."""
    left_um: float
    """True gap at the output of the alarm."""


class Played(NamedTuple):
    """The result of one approach under all variants."""

    outcomes: dict[str, Outcome]
    off_mm: list[float]
    """Of each predicted gap, from the true one at the end of its output."""
    sd_mm: list[float]


class Approach:
    """One approach; its number is the seed of all parameters."""

    def __init__(self, number: int, shape: tuple[int, int, int]) -> None:
        self.scene = random_volume_scene(number, SEED, place="inside", shape=shape)
        rng = np.random.default_rng((SEED, 40, number))
        self.speed_mm_s, self._phase_s = rng.uniform(*SPEED_MM_S), rng.uniform(0, 1 / RATE_HZ)
        self._tremor = Tremor(rng.uniform(0, 0.01), 8.0, 12.0, self.scene.seed)
        self._retina = self.scene.acquisition().retina
        scene = self.scene
        rest = self._retina.rest_mm(np.array(scene.tip_x_mm), np.array(scene.tip_z_mm))
        aim_mm = np.array([scene.tip_x_mm, float(rest.ilm_mm), scene.tip_z_mm])
        self._aim = pose(aim_mm, scene.lean_deg, scene.turn_deg, scene.needle.roll_deg)
        self.half_z_mm = scene.volume.slices * scene.volume.slice_mm / 2
        self._play()

    def pose_at(self, time_s: float) -> NeedlePose:
        """Return the needle's pose."""
        along_mm, across_mm = self._tremor.at(time_s)
        start_mm = -ABOVE_MM / math.sin(math.radians(self.scene.lean_deg))
        upper = np.cross(np.cross(self._aim.along, (0.0, 1.0, 0.0)), self._aim.along)
        way_mm = start_mm + self.speed_mm_s * time_s + along_mm
        return self._aim.moved(way_mm * self._aim.along + across_mm * upper / np.linalg.norm(upper))

    def _play(self) -> None:
        """Follow the tip in fine steps, up to the RPE."""
        step_s = 1 / RATE_HZ / FINE
        times, gaps = [], []
        while not gaps or gaps[-1] > -0.02:
            time_s = len(times) * step_s
            tip_mm = self.pose_at(time_s).tip_mm
            self._retina.press(step_s, tip_mm, time_s)
            rpe_mm = float(self._retina.at_tip(tip_mm, time_s).rpe_mm)
            times.append(time_s)
            gaps.append(self._retina.rpe_cosine(tip_mm) * (float(tip_mm[1]) - rpe_mm))
        self._times_s, self._gaps_mm = np.array(times), np.array(gaps)
        first = int(np.flatnonzero(self._gaps_mm <= 0)[0])
        before, after = gaps[first - 1], gaps[first]
        self.reached_s = float(times[first - 1] + step_s * before / (before - after))
        """When the tip is at the RPE for the first time."""

    def gap_mm(self, time_s: float) -> float:
        """Return the true gap at a time."""
        return float(np.interp(time_s, self._times_s, self._gaps_mm))

    def stamps_s(self) -> list[float]:
        """Return when the volumes are complete that are output before the RPE is reached."""
        count = int((self.reached_s - self._phase_s) * RATE_HZ) + 1
        return [self._phase_s + number / RATE_HZ for number in range(1, count)]


def ns(time_s: float) -> int:
    """Convert seconds."""
    return round(time_s * 1e9)


def with_images(number: int) -> tuple[Played, list[Sample]]:
    """Simulate an approach with images; return the result, and gap and errors in each volume."""
    approach = Approach(number, (256, 48, 192))
    acquisition, camera = approach.scene.acquisition(), approach.scene.camera()
    scale = VolumeScale(*camera.grid.shape, *camera.grid.voxel_mm)
    seen, samples = [], []
    for at, time_s in enumerate(approach.stamps_s()):
        truth = acquisition.advance(time_s, 1 / RATE_HZ, 1 / RATE_HZ, approach.pose_at, at)
        image = camera.render(truth, at)
        found = find_needle_and_surfaces(image.reshape(scale.shape), scale)
        seen.append(seen_of(found))
        if truth.needle is not None:
            samples.append(sample_of(found, truth.gap_mm, truth.needle.tip_mm))
    return played(approach, seen), samples


def seen_of(found: VolumeFindings) -> Seen:
    """Return what is reported of a volume."""
    needle = found.needle
    rpe = found.rpe if found.rpe.visible.any() else None
    if needle is None or needle.tip_mm is None:
        return Seen(None, np.zeros(3), rpe)
    return Seen(needle.tip_mm, needle.tip_sd_mm, rpe)


def sample_of(found: VolumeFindings, gap_mm: float, tip_mm: Floats) -> Sample:
    """Return the errors in a volume."""
    needle = found.needle
    if needle is None or needle.tip_mm is None or not found.rpe.visible.any():
        return Sample(gap_mm, None, 0.0, np.zeros(3))
    reported_mm = gap_to(found.rpe, needle.tip_mm, needle.tip_cov_mm2).gap_mm
    return Sample(gap_mm, needle.tip_mm - tip_mm, reported_mm - gap_mm, needle.tip_sd_mm)


def without_images(number: int, samples: list[Sample]) -> Played:
    """Simulate an approach with the ground truth and drawn errors."""
    approach, rng = Approach(number, COARSE), np.random.default_rng((SEED, 7, number))
    seen = []
    for time_s in approach.stamps_s():
        tip_mm = approach.pose_at(time_s).tip_mm
        imaged_s = ns_imaged(approach, time_s, float(tip_mm[2])) / 1e9
        tip_mm, gap_mm = approach.pose_at(imaged_s).tip_mm, approach.gap_mm(imaged_s)
        nearest = sorted(samples, key=lambda one, gap_mm=gap_mm: abs(one.gap_mm - gap_mm))[:NEIGHBOURS]
        error = nearest[int(rng.integers(len(nearest)))]
        if error.tip_off_mm is None:  # the RPE is visible beside the needle all the same
            seen.append(Seen(None, np.zeros(3), flat(float(tip_mm[1]) - gap_mm, approach.half_z_mm)))
            continue
        reported = tip_mm + error.tip_off_mm
        rpe_mm = float(reported[1]) - (gap_mm + error.gap_off_mm)
        seen.append(Seen(reported, error.tip_sd_mm, flat(rpe_mm, approach.half_z_mm)))
    return played(approach, seen)


def flat(height_mm: float, half_z_mm: float) -> HeightMap:
    """Return a flat surface."""
    ends = np.array([-half_z_mm, half_z_mm])
    return HeightMap(ends, ends, np.full((2, 2), height_mm), np.ones((2, 2), bool), np.full((2, 2), 0.005))


def ns_imaged(approach: Approach, time_s: float, z_mm: float) -> int:
    """Return when the slice of the tip was acquired."""
    return imaged_ns(ns(time_s), z_mm, flat(0.0, approach.half_z_mm), 1 / RATE_HZ)


def played(approach: Approach, reports: list[Seen]) -> Played:
    """Return when each variant gives the alarm, and the errors of the prediction."""
    settings = AheadSettings(latency_s=LATENCY_S, period_s=1 / RATE_HZ)
    ahead = TipAhead(settings)
    alarms: dict[str, float] = {}
    off_mm, sds_mm = [], []
    for time_s, one in zip(approach.stamps_s(), reports, strict=True):
        z_mm = 0.0 if one.tip_mm is None else float(one.tip_mm[2])
        stamps = ns(time_s), ns_imaged(approach, time_s, z_mm)
        predicted = ahead.update(*stamps, one.tip_mm, one.tip_sd_mm, one.rpe)
        if one.rpe is None:
            continue
        seen = one.tip_mm is not None and gap_to(one.rpe, one.tip_mm, np.diag(one.tip_sd_mm**2))
        is_near = bool(seen) and seen.gap_mm <= ALARM_MM
        gap = predicted and gap_to(one.rpe, predicted.tip_mm, np.diag(predicted.sd_mm**2))
        for name, rule in VARIANTS.items():
            if is_near or (rule and gap and gap.gap_mm - rule[1] * gap.sd_mm <= rule[0]):
                alarms.setdefault(name, time_s + LATENCY_S)
        until_s = time_s + settings.horizon_s
        if gap and until_s < approach.reached_s:
            off_mm.append(gap.gap_mm - approach.gap_mm(until_s))
            sds_mm.append(gap.sd_mm)
    results = {name: outcome(approach, alarms.get(name)) for name in VARIANTS}
    return Played(results, off_mm, sds_mm)


def outcome(approach: Approach, alarm_s: float | None) -> Outcome:
    """Return lead and gap of an alarm."""
    if alarm_s is None or alarm_s >= approach.reached_s:
        return Outcome(-math.inf, -math.inf)
    return Outcome(1e3 * (approach.reached_s - alarm_s), 1e3 * approach.gap_mm(alarm_s))


def print_results(name: str, results: list[Played]) -> None:
    """Print how often the alarm came in time, the distribution of its lead, and the prediction's errors."""
    print(name)
    off = np.concatenate([each.off_mm for each in results])
    sds = np.concatenate([each.sd_mm for each in results])
    print(
        "  predicted gap: |error| median {:.0f}, 95 % {:.0f} µm".format(
            *np.percentile(1e3 * abs(off), (50, 95))
        )
    )
    text = "  |error| / sd: 68 % within {:.2f}, 95 % within {:.2f}"
    print(text.format(*np.percentile(np.abs(off / sds), (68.3, 95.4))))
    for variant in VARIANTS:
        found = [each.outcomes[variant] for each in results]
        leads, left = (np.array(values) for values in zip(*found, strict=True))
        in_time = leads > 0
        print(f"  {variant}: alarm before the RPE in {in_time.sum()} of {len(results)}")
        for label, values in (("lead [ms]", leads[in_time]), ("left [µm]", left[in_time])):
            if len(values):
                text = "least {:.0f}  5 % {:.0f}  median {:.0f}  95 % {:.0f}"
                print(f"    {label}  {text.format(*np.percentile(values, (0, 5, 50, 95)))}")


def draw(results: list[Played], output: str) -> None:
    """Draw the distribution of the lead."""
    from matplotlib.figure import Figure

    sheet = Figure(figsize=(9, 3.2), layout="constrained")
    lead, left = sheet.subplots(1, 2)
    for variant, color in zip(SHOWN, ("#b3402e", "#20507a"), strict=True):
        some = [each.outcomes[variant] for each in results if each.outcomes[variant].lead_ms > 0]
        label = f"{variant}: {len(some)} of {len(results)}"
        lead.hist([one.lead_ms for one in some], 40, color=color, alpha=0.6, label=label)
        left.hist([one.left_um for one in some], 40, color=color, alpha=0.6)
    lead.set(xlabel="alarm before the tip is at the RPE [ms]", ylabel="approaches", xlim=(0, None))
    left.set(xlabel="true gap at the alarm [µm]", xlim=(0, None))
    lead.legend(fontsize=8, frameon=False)
    for axes in (lead, left):
        axes.spines[["top", "right"]].set_visible(False)
    sheet.suptitle(f"{len(results)} simulated approaches, 0.1 to 0.4 mm/s, {RATE_HZ:.0f} volumes/s")
    sheet.savefig(output, dpi=100)


def main() -> None:
    """Simulate, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("approaches", nargs="?", type=int, default=1000)
    parser.add_argument("--images", type=int, default=16)
    parser.add_argument("--figure")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    simulated = [with_images(number) for number in range(options.images)]
    print_results(f"with images ({options.images})", [result for result, _ in simulated])
    samples = [samples for _, samples in simulated]
    pooled = [one for each in samples for one in each]
    error_um = 1e3 * np.array([one.gap_off_mm for one in pooled if one.tip_off_mm is not None])
    spread = f"median {np.median(error_um):+.0f}, 95 % within {np.percentile(np.abs(error_um), 95):.0f}"
    missed = np.mean([one.tip_off_mm is None for one in pooled])
    print(f"  error of the gap [µm]: {spread}; no tip in {100 * missed:.1f} % of {len(pooled)} volumes")
    rng = np.random.default_rng(SEED)
    results = [
        without_images(number, samples[int(rng.integers(len(samples)))])
        for number in range(options.images, options.images + options.approaches)
    ]
    print_results(f"with these errors, without images ({options.approaches})", results)
    if options.figure:
        draw(results, options.figure)


if __name__ == "__main__":
    main()
