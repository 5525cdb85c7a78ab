"""Learn the model of an instrument from volumes that show it in different poses, without labels.

Volumes are registered to their mean, and the mean is taken anew (generalised Procrustes analysis).
"""

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.messages import Volume
from haptigraph.perception.instrument.alignment import Alignment, align
from haptigraph.perception.instrument.first_estimate import FirstEstimate, estimate_first, foreground_level
from haptigraph.perception.instrument.mean_volume import MeanGrid, RawTemplate
from haptigraph.perception.instrument.model import InstrumentModel, VoxelMm
from haptigraph.perception.instrument.rotations import Array, mean_rotation, rotation_vector
from haptigraph.perception.native.volume import ReducedVolume, reduce_volume

__all__ = ["MIN_VOLUMES", "learn_instrument", "usable_rows"]

MIN_VOLUMES = 8
MAX_VOLUMES = 200
"""Evenly spaced ones are taken of more."""
MAX_FOR_REFLECTIONS = 20
REFLECTION_GREY = 8
"""A row whose median grey is higher in almost every volume is a fixed reflection."""
REFLECTION_SHARE = 0.9
ROUNDS = 5
OUTLIER_SDS = 6.0
"""A registration whose cost is further above the median has gone wrong."""
PARTS = 6
"""Of the template along the axis that are left out in turn, for the standard deviations."""
MAX_FOR_SD = 40

Progress = Callable[[str, int, int], object]


class _Learned(Struct):
    """Volumes in the course of learning."""

    reduced: list["_Kept"]
    first: list[FirstEstimate]
    poses: list[Alignment]


def learn_instrument(
    volumes: Sequence[Volume], voxel_mm: VoxelMm, progress: Progress | None = None
) -> InstrumentModel:
    """Learn an instrument and the fixed reflections of the scanner.

    Args:
        volumes: Of one shape, the instrument alone in each, its shaft reaching out of the volume, in poses
            that differ by tenths of a millimetre and a few degrees. Each is read at most twice.
        voxel_mm: Size of a voxel along rows, slices and columns.
        progress: Receives what is done, how many of how many.

    Raises:
        BadInput: If the volumes are too few or show no instrument.
    """
    if len(volumes) < MIN_VOLUMES:
        raise BadInput(f"an instrument is learned from at least {MIN_VOLUMES} volumes; found {len(volumes)}")
    report = progress or (lambda what, done, total: None)
    taken = _evenly(len(volumes), MAX_VOLUMES)
    is_usable = usable_rows([volumes[i] for i in _evenly(len(volumes), MAX_FOR_REFLECTIONS)])
    rows = len(is_usable)
    reduced = []
    for done, i in enumerate(taken):
        reduced.append(_Kept.of(reduce_volume(volumes[i], is_usable)))
        report("reading volumes", done + 1, len(taken))
    level = float(np.median([foreground_level(each.expanded()) for each in reduced[:MAX_FOR_REFLECTIONS]]))
    first = [estimate_first(each.expanded(), rows, voxel_mm, level) for each in reduced]
    found = [(volume, each) for volume, each in zip(reduced, first, strict=True) if each is not None]
    if len(found) < MIN_VOLUMES:
        problem = f"only {len(found)} of {len(taken)} volumes show a bright instrument"
        raise BadInput(f"{problem}; at least {MIN_VOLUMES} must")
    state = _Learned(
        [volume for volume, _ in found],
        [each for _, each in found],
        [Alignment(np.eye(3), each.tip_mm, 0.0, 1.0) for _, each in found],
    )
    template = _iterate(state, rows, voxel_mm, level, report)
    return _model(state, template, is_usable, voxel_mm, level)


def usable_rows(volumes: Sequence[Volume]) -> NDArray[np.bool_]:
    """Return the rows without a fixed reflection, (rows,).

    A reflection's median is bright in almost every volume; a row on either side belongs to it.
    """
    medians = np.array([np.median(volume, axis=(1, 2)) for volume in volumes])
    above = medians - np.median(medians, axis=1, keepdims=True) >= REFLECTION_GREY
    is_reflection = np.pad(above.mean(axis=0) >= REFLECTION_SHARE, 1)
    return np.asarray(~(is_reflection[:-2] | is_reflection[1:-1] | is_reflection[2:]))


def _iterate(state: _Learned, rows: int, voxel_mm: VoxelMm, level: float, report: Progress) -> RawTemplate:
    """Register all volumes to their mean, round by round; return the last mean."""
    tips = np.array([each.tip_mm for each in state.first])
    reference = int(np.argmin(np.linalg.norm(tips - np.median(tips, axis=0), axis=1)))
    grid = MeanGrid.around(state.reduced[reference].expanded(), tips[reference], rows, voxel_mm, level)
    template = grid.mean([state.reduced[reference].expanded()], [state.poses[reference]])
    for number in range(ROUNDS):
        for i, volume in enumerate(state.reduced):
            start = state.poses[i]
            state.poses[i] = align(
                *(volume.expanded(), template.template, rows, voxel_mm, start.rotation, start.origin_mm)
            )
            report("registering volumes", number * len(tips) + i + 1, ROUNDS * len(tips))
        kept = _inliers(state.poses)
        if len(kept) < MIN_VOLUMES:
            raise BadInput(
                f"only {len(kept)} of {len(tips)} volumes fit each other; at least {MIN_VOLUMES} must"
            )
        template = grid.mean((state.reduced[i].expanded() for i in kept), [state.poses[i] for i in kept])
    return template


def _model(
    state: _Learned, template: RawTemplate, is_usable: NDArray[np.bool_], voxel_mm: VoxelMm, level: float
) -> InstrumentModel:
    """Register once more, with all points and with halves of them, and return the model."""
    rows = len(is_usable)
    tip, axis, bevel = template.tip_axis_bevel(level)
    for i, volume in enumerate(state.reduced):
        start = state.poses[i]
        state.poses[i] = align(
            volume.expanded(), template.template, rows, voxel_mm, start.rotation, start.origin_mm
        )
    kept = _inliers(state.poses)
    turn = mean_rotation(state.poses[i].rotation for i in kept)
    some = [kept[i] for i in _evenly(len(kept), MAX_FOR_SD)]
    sd = _jackknifed_sd(state, some, rows, voxel_mm, template, (tip, axis))
    missed = [
        turn @ state.poses[i].rotation.T @ (state.first[i].tip_mm - _tip_mm(state.poses[i], tip))
        for i in kept
    ]
    return InstrumentModel(
        voxel_mm=voxel_mm,
        is_usable=is_usable,
        points_mm=np.ascontiguousarray((template.points_mm - tip) @ turn.T, np.float32),
        values=template.values,
        gradients=np.ascontiguousarray(template.gradients @ turn.T, np.float32),
        axis=turn @ axis,
        bevel=turn @ bevel,
        start_mm=np.median(missed, axis=0),
        level=level,
        cost_limit=_cost_limit([each.cost for each in state.poses]),
        tip_sd_mm=np.array(sd[:3]),
        axis_sd_deg=float(np.rad2deg(np.hypot(sd[3], sd[4]) / np.sqrt(2))),
        roll_sd_deg=float(np.rad2deg(sd[5])),
        volumes=len(kept),
    )


def _jackknifed_sd(
    state: _Learned,
    some: Sequence[int],
    rows: int,
    voxel_mm: VoxelMm,
    template: RawTemplate,
    ends: "tuple[Array, Array]",
) -> Array:
    """Return standard deviations of tip [mm], two angles of the axis and roll [rad], (6,).

    Parts along the axis are left out in turn (delete-a-group jackknife): what a registration errs by differs
    from part to part, also where it is no noise.

    Args:
        state: Volumes and their poses.
        some: Which of them to use.
        rows: Of the volumes.
        voxel_mm: Size of their voxels.
        template: The mean volume.
        ends: Its tip and axis.
    """
    tip, axis = ends
    along = template.points_mm @ axis
    part = np.searchsorted(np.quantile(along, np.linspace(0, 1, PARTS + 1)[1:-1]), along)
    variances = []
    for i in some:
        pose, volume = state.poses[i], state.reduced[i].expanded()
        start = pose.rotation, pose.origin_mm
        differences = []
        for left_out in range(PARTS):
            used = np.ascontiguousarray(part != left_out)
            differences.append(
                _difference(pose, align(volume, template.template, rows, voxel_mm, *start, used), tip, axis)
            )
        variances.append((PARTS - 1) * np.var(differences, axis=0))
    sd: Array = np.sqrt(np.mean(np.sort(variances, axis=0)[: -max(1, len(some) // 20)], axis=0))
    return sd


def _difference(a: Alignment, b: Alignment, tip: Array, axis: Array) -> Array:
    """Return by how much two poses differ: tip [mm], two angles of the axis and the roll [rad], (6,)."""
    turned = rotation_vector(a.rotation.T @ b.rotation)
    across = np.linalg.svd(axis[None])[2][1:]
    return np.concatenate([_tip_mm(b, tip) - _tip_mm(a, tip), across @ turned, [axis @ turned]])


def _tip_mm(pose: Alignment, tip: Array) -> Array:
    return pose.rotation @ tip + pose.origin_mm


def _cost_limit(costs: Sequence[float]) -> float:
    middle = float(np.median(costs))
    return middle + OUTLIER_SDS * max(
        1.4826 * float(np.median(np.abs(np.subtract(costs, middle)))), 0.1 * middle
    )


def _inliers(poses: Sequence[Alignment]) -> list[int]:
    limit = _cost_limit([each.cost for each in poses])
    return [i for i, each in enumerate(poses) if each.cost <= limit]


def _evenly(count: int, most: int) -> list[int]:
    """Return at most so many evenly spaced indices."""
    return [int(i) for i in np.linspace(0, count - 1, min(count, most)).round()]


class _Kept(Struct, frozen=True, eq=False):
    """A reduced volume with a byte a cell, for many of them in memory."""

    cells: NDArray[np.uint8]
    ends: tuple[int, int]

    @classmethod
    def of(cls, volume: ReducedVolume) -> "_Kept":
        return cls(np.rint(volume.cells).astype(np.uint8), (volume.first_cell, volume.last_cell))

    def expanded(self) -> ReducedVolume:
        return ReducedVolume(self.cells.astype(np.float32), *self.ends)
