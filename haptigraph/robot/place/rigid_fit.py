"""The rigid transform between a robot's base and the eye frame: pairs of points -> transform, covariance.

Closed form by singular value decomposition (Arun, Huang and Blostein 1987, IEEE PAMI 9(5); Umeyama 1991, IEEE
PAMI 13(4) for mirrored points and scale), which is the weighted least-squares optimum for errors that are the
same in all directions. Outliers are left out by their distance from the best fit of few points.
"""

import math
from itertools import combinations

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.robot.pose import Floats, Transform

__all__ = ["MAD_TO_SD", "MIN_SPREAD_MM", "Fit", "RigidFit", "fit_points", "inliers", "procrustes"]

MIN_SPREAD_MM = 0.5
"""Least extent of the points, RMS, in the second of their principal directions."""
PLANE_MM = 0.2  # less extent than that in the third direction is a plane
MIN_INLIERS = 0.6
MIN_FOR_OUTLIERS = 7  # among fewer points, none can be singled out
OUTLIER_SDS = 4.0
MAX_SCALE_ERROR = 0.03
SUBSETS = 300
MAD_TO_SD = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""


class Fit(Struct, frozen=True):
    """The best transform of some pairs."""

    rotation: Floats
    """From the base to the eye frame."""
    base_mm: Floats
    """Centroid in the base, (3,)."""
    eye_mm: Floats
    """Centroid in the eye frame, (3,)."""
    scale: float
    """The scale at which the points would fit best; 1 in the transform itself."""
    is_mirrored: bool
    """Whether a reflection fits better."""
    residual_mm: Floats
    """Of every pair, eye frame, (n, 3)."""

    @property
    def eye_from_base(self) -> Transform:
        """The transform."""
        return Transform(self.rotation, self.eye_mm - self.rotation @ self.base_mm)


class RigidFit(Struct, frozen=True):
    """A transform from the robot's base to the eye frame that passed all checks."""

    eye_from_base: Transform
    covariance: Floats
    """Of rotation vector [rad] and centroid [mm] in the eye frame, (6, 6)."""
    centroid_mm: Floats
    """Of the points used, eye frame."""
    residual_mm: Floats
    """Of every pair, (n, 3)."""
    used: Floats
    """Whether each pair was used, (n,)."""
    noise_mm: float
    """Standard deviation of one pair per axis, from the residuals or as given, whichever is larger."""
    is_planar: bool
    """Whether the points lie in one plane: then a mirrored robot would fit as well."""

    @property
    def rms_mm(self) -> float:
        """RMS residual of the pairs used, as distances."""
        squared = (self.residual_mm[self.used > 0] ** 2).sum(axis=1)
        return math.sqrt(float(squared.mean()))

    def sd_at_mm(self, point_mm: Floats, axes: int = 3) -> float:
        """Return the standard deviation of the transform at a point of the eye frame, per axis (RMS).

        Args:
            point_mm: The point.
            axes: Of the eye frame, that are meant: 2 are x and y.
        """
        jacobian = _jacobian(point_mm - self.centroid_mm)[:axes]
        return math.sqrt(float(np.trace(jacobian @ self.covariance @ jacobian.T)) / axes)

    def turn_sd_deg(self) -> Floats:
        """Return the standard deviations of the rotation about x, y and z of the eye frame, (3,)."""
        sds: Floats = np.degrees(np.sqrt(np.diag(self.covariance)[:3]))
        return sds


def procrustes(base_mm: Floats, eye_mm: Floats, weight: Floats) -> Fit:
    """Fit one rigid transform, without checks.

    Args:
        base_mm: Points in the robot's base, (n, 3).
        eye_mm: The same points in the eye frame, (n, 3).
        weight: Of the pairs, (n,); 0 leaves one out.
    """
    share = weight / weight.sum()
    base_c, eye_c = share @ base_mm, share @ eye_mm
    one, other = base_mm - base_c, eye_mm - eye_c
    u, sizes, vt = np.linalg.svd((other * share[:, None]).T @ one)
    sign = np.array([1.0, 1.0, math.copysign(1.0, float(np.linalg.det(u @ vt)))])
    rotation = u @ (sign[:, None] * vt)
    spread = float(share @ (one**2).sum(axis=1))
    return Fit(
        rotation,
        base_c,
        eye_c,
        float(sizes @ sign) / max(spread, 1e-12),
        bool(sign[2] < 0),
        other - one @ rotation.T,
    )


def inliers(base_mm: Floats, eye_mm: Floats, sd_mm: Floats) -> Floats:
    """Return which pairs agree with the best fit of few: 1 or 0, (n,).

    Of random triples, the fit with the smallest median residual (Rousseeuw 1984, J. Am. Stat. Assoc. 79)
    names as outliers the pairs beyond 4 robust standard deviations. The same points have the same triples.
    """
    count = len(base_mm)
    if count < MIN_FOR_OUTLIERS:
        return np.ones(count)
    best, chosen = math.inf, np.zeros(count)
    for triple in _triples(count):
        weight = np.zeros(count)
        weight[list(triple)] = 1.0
        distance = np.linalg.norm(procrustes(base_mm, eye_mm, weight).residual_mm, axis=1) / sd_mm
        median = float(np.median(distance))
        if median < best:
            best, chosen = median, distance
    limit = OUTLIER_SDS * max(MAD_TO_SD * best * (1 + 5 / (count - 3)), 1.0)
    weight = (chosen <= limit) / sd_mm**2
    distance = np.linalg.norm(procrustes(base_mm, eye_mm, weight).residual_mm, axis=1) / sd_mm
    used: Floats = (distance <= limit).astype(np.float64)
    return used


def fit_points(base_mm: Floats, eye_mm: Floats, sd_mm: Floats, *, max_rms_mm: float, what: str) -> RigidFit:
    """Fit the transform and check that the points determine it.

    Args:
        base_mm: Points in the robot's base, (n, 3).
        eye_mm: The same points in the eye frame, (n, 3).
        sd_mm: Standard deviation of each pair per axis, (n,).
        max_rms_mm: Largest RMS residual that is accepted.
        what: Names the points in errors.

    Raises:
        BadInput: If they are too few, collinear, mirrored, of another scale, or inconsistent.
    """
    if len(base_mm) < 4:
        raise BadInput(f"{len(base_mm)} points are too few; touch at least 4, far apart", what)
    _check_units(base_mm, eye_mm, what)
    extent = _extents_mm(base_mm)
    if extent[1] < max(MIN_SPREAD_MM, 3 * float(np.median(sd_mm))):
        raise BadInput(
            f"the points lie within {extent[1]:.2f} mm of one line, about which the rotation stays free; "
            "touch points further apart",
            what,
        )
    used = inliers(base_mm, eye_mm, sd_mm)
    weight = used / sd_mm**2
    fit = procrustes(base_mm, eye_mm, weight)
    is_planar = bool(_extents_mm(base_mm[used > 0])[2] < max(PLANE_MM, 3 * float(np.median(sd_mm))))
    _check_shape(fit, base_mm, eye_mm, sd_mm, is_planar=is_planar, max_rms_mm=max_rms_mm, what=what)
    if used.sum() < max(4, MIN_INLIERS * len(used)):
        raise BadInput(
            f"only {used.sum():.0f} of {len(used)} points agree with one transform; touch them again", what
        )
    rms_mm = math.sqrt(float((fit.residual_mm[used > 0] ** 2).sum(axis=1).mean()))
    if rms_mm > max_rms_mm:
        raise BadInput(
            f"the points do not fit one transform: RMS residual {rms_mm:.2f} mm, at most {max_rms_mm:g} mm "
            "is accepted; touch them again",
            what,
        )
    factor = _variance_factor(fit.residual_mm, weight)
    information = _information(eye_mm - fit.residual_mm - fit.eye_mm, weight)
    covariance = (factor * np.linalg.inv(information)).astype(np.float64)
    noise_mm = math.sqrt(factor / float(np.mean(weight[used > 0])))
    return RigidFit(fit.eye_from_base, covariance, fit.eye_mm, fit.residual_mm, used, noise_mm, is_planar)


def _check_units(base_mm: Floats, eye_mm: Floats, what: str) -> None:
    """Refuse another unit of length."""
    scale = _scale(base_mm, eye_mm)
    if abs(scale - 1.0) > 0.5:
        names = {1000.0: "; the robot seems to report m instead of mm", 0.001: "; µm instead of mm"}
        near = min(names, key=lambda one: abs(math.log(scale / one)))
        hint = names[near] if 0.5 < scale / near < 2 else ""
        raise BadInput(f"distances in the eye are {scale:.4g} times those of the robot{hint}", what)


def _check_shape(
    fit: Fit,
    base_mm: Floats,
    eye_mm: Floats,
    sd_mm: Floats,
    *,
    is_planar: bool,
    max_rms_mm: float,
    what: str,
) -> None:
    """Refuse mirrored points, and a scale that is a little off."""
    mirrored = procrustes(base_mm * (1.0, 1.0, -1.0), eye_mm, 1 / sd_mm**2)
    straight = procrustes(base_mm, eye_mm, 1 / sd_mm**2)
    ours, theirs = (float(np.median(np.linalg.norm(one.residual_mm, axis=1))) for one in (straight, mirrored))
    if not is_planar and theirs < ours / 2 and ours > max(3 * float(np.median(sd_mm)), max_rms_mm / 4):
        raise BadInput(
            f"the points fit a mirrored frame ({theirs:.2f} mm) better than a right-handed one "
            f"({ours:.2f} mm); check the signs of the robot's axes, and the registration's `mirrored`",
            what,
        )
    scale_sd = float(np.median(sd_mm)) / (_extents_mm(base_mm)[0] * math.sqrt(len(base_mm)))
    limit = max(MAX_SCALE_ERROR, 5 * scale_sd)
    if abs(fit.scale - 1.0) > limit:
        raise BadInput(
            f"distances in the eye are {fit.scale:.3f} times those of the robot; check the robot's units and "
            "the globe's diameter in the registration",
            what,
        )


def _scale(base_mm: Floats, eye_mm: Floats) -> float:
    """Return the median ratio of the distances between points, which few outliers do not change."""
    one, other = np.triu_indices(min(len(base_mm), 200), 1)
    base, eye = (np.linalg.norm(points[one] - points[other], axis=1) for points in (base_mm, eye_mm))
    return float(np.median(eye / np.maximum(base, 1e-9)))


def _variance_factor(residual_mm: Floats, weight: Floats) -> float:
    """Return how much larger the variance is than stated; at least 1."""
    used = int((weight > 0).sum())
    freedom = 3 * used - 6
    return max(1.0, float((weight[:, None] * residual_mm**2).sum()) / freedom) if freedom > 0 else 1.0


def _information(offset_mm: Floats, weight: Floats) -> Floats:
    """Return the information matrix of rotation and centroid, (6, 6)."""
    total = np.zeros((6, 6))
    for offset, each in zip(offset_mm, weight, strict=True):
        if each > 0:
            jacobian = _jacobian(offset)
            total += each * jacobian.T @ jacobian
    return total


def _jacobian(offset_mm: Floats) -> Floats:
    """Return how a point moves with the rotation vector and the centroid, (3, 6)."""
    x, y, z = offset_mm
    return np.column_stack((np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]), np.eye(3)))


def _extents_mm(points_mm: Floats) -> Floats:
    """Return the RMS extents of points in their principal directions, largest first, (3,)."""
    centred = points_mm - points_mm.mean(axis=0)
    extents: Floats = np.linalg.svd(centred, compute_uv=False) / math.sqrt(len(points_mm))
    return np.pad(extents, (0, 3 - len(extents)))


def _triples(count: int) -> list[tuple[int, ...]]:
    """Return subsets of three points; all of them if they are few, else the same random ones every time."""
    if math.comb(count, 3) <= SUBSETS:
        return list(combinations(range(count), 3))
    random = np.random.default_rng(count)
    return [tuple(random.choice(count, 3, replace=False).tolist()) for _ in range(SUBSETS)]
