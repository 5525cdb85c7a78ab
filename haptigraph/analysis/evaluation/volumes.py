"""Score the poses of an instrument in labelled volumes.

Every second volume in time calibrates: of these the model of the instrument is learned, and to their labels
the map from the scanner to the hexapod is fitted. The others are reported on.
"""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from haptigraph.analysis.evaluation.volume_map import QuadraticMap, fit_offset_mm
from haptigraph.errors import BadInput
from haptigraph.perception.instrument.finding import find_instrument
from haptigraph.perception.instrument.learning import learn_instrument
from haptigraph.perception.instrument.model import InstrumentModel, InstrumentPose, VoxelMm
from haptigraph.perception.instrument.rotations import (
    Array,
    euler_xyz_matrix,
    nearest_rotation,
    rotation_vector,
)
from haptigraph.perception.instrument.volume_folder import VolumeFolder
from haptigraph.recording.writer import Progress

__all__ = ["Residuals", "VolumeEvaluation", "evaluate_volumes"]

MIN_CALIBRATIONS = 30
"""A quadratic map has 28 coefficients per component; the priors support it down to this number."""
SECONDS_PER_HOUR = 3600.0


class Residuals(Struct, frozen=True, eq=False):
    """Labelled less predicted, of the reported volumes with a known pose."""

    tip_mm: Array
    """(n, 3) along the axes of the hexapod."""
    tip_sd_mm: Array
    """What was predicted of them, (n, 3)."""
    axis_deg: Array
    """Angle between the axes, (n,)."""
    position_mm: Array
    """Of the labelled position itself, which is another point than the tip, (n, 3)."""


class VolumeEvaluation(Struct, frozen=True, eq=False):
    """The result of an evaluation."""

    calibrated: int
    """Volumes of which the model was learned and to which the map was fitted."""
    reported: int
    """Volumes that were reported on."""
    known: int
    """Those of them whose pose is known."""
    offset_mm: Array
    """Of the tip from the labelled position, in the labelled frame."""
    without_drift: Residuals
    with_drift: Residuals
    find_ms: Array
    """Processor time of each search, (calibrated + reported,)."""
    learn_s: float
    """Time to learn the model."""


class _Measured(Struct, frozen=True, eq=False):
    """What is known of the volumes whose pose was found."""

    hours: Array
    poses: list[InstrumentPose]
    labels: Array
    rotations: Array

    @property
    def features(self) -> Array:
        """Return position and rotation vector, (n, 6)."""
        features = [np.concatenate([pose.tip_mm, rotation_vector(pose.rotation)]) for pose in self.poses]
        return np.array(features).reshape(-1, 6)


def evaluate_volumes(
    folder: str | Path, voxel_mm: VoxelMm, progress: Progress | None = None, *, swapped: bool = False
) -> VolumeEvaluation:
    """Score the poses found in a folder of labelled volumes.

    Args:
        folder: See `VolumeFolder`; all files have labels.
        voxel_mm: Size of a voxel along rows, slices and columns.
        progress: Receives what is done.
        swapped: Calibrate with the second of every two volumes instead of the first.

    Raises:
        BadInput: If a file is not valid, or too few volumes calibrate a quadratic map.
    """
    volumes = VolumeFolder(folder)
    halves = [np.arange(len(volumes))[start::2] for start in (0, 1)]
    calibrating, reporting = reversed(halves) if swapped else halves
    if len(calibrating) < MIN_CALIBRATIONS or not len(reporting):
        found = f"found {len(volumes)} volumes, {len(calibrating)} of them to calibrate"
        raise BadInput(f"{found}; a quadratic map needs at least {2 * MIN_CALIBRATIONS} volumes", folder)
    labels = volumes.labels()
    report = progress or (lambda what, done, total: None)
    start = time.monotonic()
    model = learn_instrument(volumes[int(calibrating[0]) :: 2], voxel_mm, report)
    learn_s = time.monotonic() - start
    poses, find_ms = _find_all(volumes, model, report)
    hours = (volumes.seconds - volumes.seconds[0]) / SECONDS_PER_HOUR
    calibration, held_out = (_measured(half, poses, labels, hours) for half in (calibrating, reporting))
    if len(calibration.poses) < MIN_CALIBRATIONS:
        found = (
            f"the instrument was found in {len(calibration.poses)} of {len(calibrating)} volumes to calibrate"
        )
        raise BadInput(f"{found}; a quadratic map needs {MIN_CALIBRATIONS}", folder)
    offset = fit_offset_mm(
        *(
            np.array([pose.tip_mm for pose in calibration.poses]),
            calibration.labels[:, :3],
            calibration.rotations,
        )
    )
    without, with_ = _residuals(calibration, held_out, offset)
    return VolumeEvaluation(
        *(len(calibrating), len(reporting), len(held_out.poses), offset, without, with_, find_ms, learn_s)
    )


def _find_all(
    volumes: VolumeFolder, model: InstrumentModel, report: Progress
) -> tuple[list[InstrumentPose | None], Array]:
    """Return the pose in each volume, and the processor time of each search [ms]."""
    poses, find_ms = [], np.empty(len(volumes))
    for number in range(len(volumes)):
        volume = volumes[number]
        before = time.process_time()
        poses.append(find_instrument(volume, model))
        find_ms[number] = (time.process_time() - before) * 1e3
        report("finding the instrument", number + 1, len(volumes))
    return poses, find_ms


def _measured(
    half: Iterable[int], poses: Sequence[InstrumentPose | None], labels: Array, hours: Array
) -> _Measured:
    known = [(i, pose) for i in half if (pose := poses[i]) is not None]
    indices = [i for i, _ in known]
    rotations = np.array([euler_xyz_matrix(labels[i, 3:]) for i in indices]).reshape(-1, 3, 3)
    return _Measured(hours[indices], [pose for _, pose in known], labels[indices], rotations)


def _residuals(calibration: _Measured, held_out: _Measured, offset: Array) -> list[Residuals]:
    """Fit maps to one half, and compare them with the labels of the other: without and with drift."""
    tips, true_tips = (each.labels[:, :3] + each.rotations @ offset for each in (calibration, held_out))
    axis_deg = _axis_residuals(calibration, held_out, _labelled_axis(calibration, tips))
    residuals = []
    for has_drift in (False, True):
        tip, tip_sd = _predicted(calibration, held_out, tips, has_drift=has_drift)
        position, _ = _predicted(calibration, held_out, calibration.labels[:, :3], has_drift=has_drift)
        position_mm = held_out.labels[:, :3] - position
        residuals.append(Residuals(true_tips - tip, tip_sd, axis_deg, position_mm))
    return residuals


def _axis_residuals(calibration: _Measured, held_out: _Measured, axis: Array) -> Array:
    """Return the angles between predicted and labelled axes; the orientation does not drift, (n,)."""
    angles, _ = _predicted(calibration, held_out, calibration.labels[:, 3:], has_drift=False)
    predicted = np.array([euler_xyz_matrix(each) @ axis for each in angles]).reshape(-1, 3)
    labelled = held_out.rotations @ axis
    sine = np.linalg.norm(np.cross(predicted, labelled), axis=1)
    angles_deg: Array = np.rad2deg(np.arctan2(sine, np.sum(predicted * labelled, axis=1)))
    return angles_deg


def _predicted(
    calibration: _Measured, held_out: _Measured, values: Array, *, has_drift: bool
) -> tuple[Array, Array]:
    """Return predictions of three components of the labels, and their standard deviations, (n, 3) each."""
    measured, others = calibration.features, held_out.features
    maps = [QuadraticMap(measured, calibration.hours, column, has_drift=has_drift) for column in values.T]
    predictions = [each.predict(others, held_out.hours) for each in maps]
    return np.column_stack([each.values for each in predictions]), np.column_stack(
        [each.sds for each in predictions]
    )


def _labelled_axis(calibration: _Measured, tips: Array) -> Array:
    """Return the shaft's direction in the labelled frame, by a rotation between the frames from the tips."""
    measured = np.array([pose.tip_mm for pose in calibration.poses])
    linear = np.linalg.lstsq(measured - measured.mean(axis=0), tips - tips.mean(axis=0), rcond=None)[0]
    between = nearest_rotation(linear.T)
    in_label = [
        r.T @ between @ pose.axis for r, pose in zip(calibration.rotations, calibration.poses, strict=True)
    ]
    mean = np.mean(in_label, axis=0)
    axis: Array = mean / np.linalg.norm(mean)
    return axis
