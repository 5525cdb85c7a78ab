"""Acquire a volume slice by slice while needle and retina move: from poses over time to the ground truth."""

import math
from collections.abc import Callable

import numpy as np

from haptigraph.sim.oct.bscan import ScanSettings
from haptigraph.sim.oct.retina import RetinaShape
from haptigraph.sim.oct.volumes.needle import NeedlePose, VolumeNeedle
from haptigraph.sim.oct.volumes.retina import VolumeRetina
from haptigraph.sim.oct.volumes.volume import Grid, VolumeSettings, VolumeTruth

__all__ = ["Acquisition", "PoseAt"]

PoseAt = Callable[[float], NeedlePose | None]
"""Pose of the needle at a time [s]; None: it is not in view."""
SEARCHES = 3  # for the slice that contains the moving tip


class Acquisition:
    """Acquire volumes of one retina.

    Args:
        scan: Size and scale of a slice.
        volume: Number and distance of the slices.
        retina: Shape and motion of the retina.
        needle: Dimensions of the needle.
        seed: Seed of the retina's irregularity and of its displacement from slice to slice.
    """

    def __init__(
        self,
        scan: ScanSettings,
        volume: VolumeSettings,
        retina: RetinaShape,
        needle: VolumeNeedle,
        seed: int,
    ) -> None:
        self.grid = Grid(scan, volume)
        self.retina = VolumeRetina(retina, volume.tilt_deg, self.grid.x_mm, self.grid.z_mm, seed)
        self._needle, self._volume, self._seed = needle, volume, seed

    def restart(self) -> None:
        """Return to the resting retina."""
        self.retina.restart()

    def advance(
        self, time_s: float, elapsed_s: float, duration_s: float, pose_at: PoseAt, number: int = 0
    ) -> VolumeTruth:
        """Return the ground truth of one volume.

        Args:
            time_s: When its last slice is acquired.
            elapsed_s: Time since the last call.
            duration_s: Time from the first slice of a volume to the first of the next, at full duty.
            pose_at: Pose of the needle at any time.
            number: Number of the volume; chooses the displacement from slice to slice.
        """
        times_s = self._times_s(time_s, duration_s)
        tip_time_s = self._tip_time_s(times_s, pose_at)
        needle = pose_at(tip_time_s)
        self.retina.press(elapsed_s, None if needle is None else needle.tip_mm, tip_time_s)
        rng = np.random.default_rng((self._seed, 32, number))
        jitter_mm = self._volume.jitter_mm * rng.standard_normal(len(times_s))
        moved_mm = np.array([self.retina.motion_mm(time) for time in times_s]) + jitter_mm
        heights = self.retina.heights(moved_mm)
        poses = tuple(pose_at(time) for time in times_s)
        truth = VolumeTruth(self.grid, self._needle, heights.ilm_mm, heights.rpe_mm, poses)
        if needle is None:
            return truth
        at_tip = self.retina.at_tip(needle.tip_mm, tip_time_s)
        shift_mm = float(np.interp(tip_time_s, times_s, jitter_mm))
        return VolumeTruth(
            self.grid,
            self._needle,
            heights.ilm_mm,
            heights.rpe_mm,
            poses,
            needle,
            float(at_tip.ilm_mm) + shift_mm,
            float(at_tip.rpe_mm) + shift_mm,
            math.degrees(math.acos(self.retina.rpe_cosine(needle.tip_mm))),
            tip_time_s,
            self.retina.is_pierced,
        )

    def _times_s(self, time_s: float, duration_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return the time of each slice, (n,)."""
        slices = self._volume.slices
        return time_s - np.arange(slices - 1, -1, -1) * duration_s / slices

    def _tip_time_s(self, times_s: np.ndarray[tuple[int], np.dtype[np.float64]], pose_at: PoseAt) -> float:
        """Return the time at which the slice that contains the tip is acquired; without a tip, the last."""
        at_s = float(times_s[-1])
        for _ in range(SEARCHES):
            needle = pose_at(at_s)
            if needle is None:
                return float(times_s[-1])
            at_s = float(np.interp(needle.tip_mm[2], self.grid.z_mm, times_s))
        return at_s
