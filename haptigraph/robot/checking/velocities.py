"""Check that measured_cp and measured_cv describe one motion.

Displacements and rotations of the poses over short windows are compared with the integrals of the velocities.
If they differ, the reading of the messages that makes them agree shows what is wrong: a factor (units),
exchanged or inverted axes (a left-handed frame), another order of the quaternion, another frame.
"""

from collections.abc import Iterator
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.checking.timing import stamps_are_usable
from haptigraph.robot.pose import Floats, at_times

__all__ = ["WINDOW_S", "turned_rad", "velocity_findings"]

WINDOW_S = 0.25
MAX_FACTOR = 1.25
MAX_RESIDUAL = 0.3  # share of the motion that a reading leaves unexplained
EYE = np.eye(3)
# Identity first, then readings with fewer changes; of equal ones the first is reported.
AXES = sorted(
    (
        np.diag(signs) @ EYE[list(order)]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    ),
    key=lambda axes: -np.trace(axes),
)


class _Fit(NamedTuple):
    error: float
    scale: float
    axes: Floats

    @property
    def is_good(self) -> bool:
        return self.error <= MAX_RESIDUAL and 1 / MAX_FACTOR <= self.scale <= MAX_FACTOR


def velocity_findings(
    recorded: Recorded, time_s: Floats, position_m: Floats, rotation: Rotation
) -> Iterator[Finding]:
    """Yield the contradictions between poses and velocities.

    Args:
        recorded: With messages of measured_cv.
        time_s: Times of the poses, increasing, (n,).
        position_m: (n, 3).
        rotation: n rotations.
    """
    twist_s, twists = _twists(recorded)
    edges_s = np.arange(max(time_s[0], twist_s[0]), min(time_s[-1], twist_s[-1]), WINDOW_S)
    if len(edges_s) < 5:
        yield Finding(
            "velocity_rate", "measured_cv has too few messages; as many as of measured_cp are valid"
        )
        return
    positions = at_times(time_s, position_m, edges_s)
    moved_m = np.diff(positions, axis=0)
    integral = at_times(twist_s, _integral(twist_s, twists), edges_s)
    moved_cv_m, turned_cv_rad = np.diff(integral[:, :3], axis=0), np.diff(integral[:, 3:], axis=0)
    linear = _fit(moved_cv_m, moved_m, EYE)
    angular = _fit(turned_cv_rad, turned_rad(edges_s, time_s, rotation), EYE)
    if linear.is_good and angular.is_good:
        return
    if (found := _in_tool_frame(edges_s, time_s, rotation, moved_m, (twist_s, twists))) is not None:
        yield found
        return
    if not linear.is_good:
        yield _linear_finding(_best(moved_cv_m, moved_m))
    if not angular.is_good:
        yield _angular_finding(edges_s, time_s, rotation, turned_cv_rad)


def _twists(recorded: Recorded) -> tuple[Floats, Floats]:
    samples = recorded.twists.samples()
    use_stamps = stamps_are_usable(recorded) and not recorded.twists.unstamped
    twist_s, first = np.unique(samples.stamp_s if use_stamps else samples.received_s, return_index=True)
    return twist_s, samples.numbers[first]


def _integral(time_s: Floats, rates: Floats) -> Floats:
    areas = np.diff(time_s)[:, None] * (rates[1:] + rates[:-1]) / 2
    integral: Floats = np.vstack([np.zeros(rates.shape[1]), np.cumsum(areas, axis=0)])
    return integral


def turned_rad(edges_s: Floats, time_s: Floats, rotation: Rotation) -> Floats:
    """Return the rotation vectors between successive edges, (k - 1, 3)."""
    turned = Slerp(time_s, rotation)(edges_s)
    vectors: Floats = (turned[1:] * turned[:-1].inv()).as_rotvec()
    return vectors


def _fit(velocity: Floats, motion: Floats, axes: Floats) -> _Fit:
    """Fit motion = factor * axes * velocity over windows (n, 3)."""
    turned = velocity @ axes.T
    power = float((turned**2).sum())
    factor = float((turned * motion).sum()) / power if power else 0.0
    size = max(float(np.linalg.norm(motion)), 1e-12)
    residual = float(np.linalg.norm(motion - factor * turned)) / size
    return _Fit(residual, factor, axes)


def _best(velocity: Floats, motion: Floats) -> _Fit:
    """Return the simplest of the best readings with exchanged and inverted axes."""
    fits = [fit for fit in (_fit(velocity, motion, axes) for axes in AXES) if fit.scale > 0]
    least = min((fit.error for fit in fits), default=np.inf)
    return next((fit for fit in fits if fit.error <= least + 0.05), _Fit(np.inf, 0.0, EYE))


def _linear_finding(fit: _Fit) -> Finding:
    if fit.error > MAX_RESIDUAL:
        return Finding(
            "velocity_inconsistent",
            "positions of measured_cp do not follow the velocities of measured_cv, in no order of the axes; "
            "the velocity of the tip in the frame of measured_cp is valid",
        )
    if (fit.axes == EYE).all():
        return Finding(
            "velocity_units",
            f"positions change {fit.scale:.4g} times as fast as measured_cv says; metres and m/s are valid",
        )
    return _axes_finding("positions of measured_cp move along", fit.axes)


def _axes_finding(what: str, axes: Floats) -> Finding:
    named = ", ".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in axes)
    is_left = np.linalg.det(axes) < 0
    kind = "a left-handed frame" if is_left else "exchanged axes"
    return Finding(
        "left_handed" if is_left else "axes_exchanged",
        f"{what} {named} of measured_cv: {kind}; x, y, z of one right-handed frame are valid",
    )


def _angular_finding(edges_s: Floats, time_s: Floats, rotation: Rotation, turned_cv_rad: Floats) -> Finding:
    order = Rotation.from_quat(rotation.as_quat()[:, [1, 2, 3, 0]])
    if _fit(turned_cv_rad, turned_rad(edges_s, time_s, order), EYE).is_good:
        return Finding(
            "quaternion_order", "orientations of measured_cp are in the order w, x, y, z; x, y, z, w is valid"
        )
    if _fit(turned_cv_rad, turned_rad(edges_s, time_s, rotation.inv()), EYE).is_good:
        return Finding(
            "quaternion_inverse",
            "orientations of measured_cp are of the base in the tool's frame; those of the tool in the base "
            "are valid",
        )
    fit = _best(turned_cv_rad, turned_rad(edges_s, time_s, rotation))
    if fit.error > MAX_RESIDUAL:
        return Finding(
            "rotation_inconsistent",
            "orientations of measured_cp do not follow the angular velocities of measured_cv; those in the "
            "frame of measured_cp are valid",
        )
    if (fit.axes == EYE).all():
        return Finding(
            "velocity_units",
            f"orientations change {fit.scale:.4g} times as fast as measured_cv says; rad/s is valid",
        )
    return _axes_finding("orientations of measured_cp turn about", fit.axes)


def _in_tool_frame(
    edges_s: Floats, time_s: Floats, rotation: Rotation, moved_m: Floats, twist: tuple[Floats, Floats]
) -> Finding | None:
    twist_s, twists = twist
    inside = (twist_s >= time_s[0]) & (twist_s <= time_s[-1])
    turned = Slerp(time_s, rotation)(twist_s[inside])
    in_base = turned.apply(twists[inside, :3])
    moved_cv_m = np.diff(at_times(twist_s[inside], _integral(twist_s[inside], in_base), edges_s), axis=0)
    if not _fit(moved_cv_m, moved_m, EYE).is_good:
        return None
    return Finding(
        "velocity_frame",
        "measured_cv is in the tool's frame; velocities in the frame of measured_cp are valid",
    )
