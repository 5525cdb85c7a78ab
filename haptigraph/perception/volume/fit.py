"""Fit a bevelled needle to the A-scans around a shaft.

Turns evidence per A-scan (`light.light_stops`) into the posterior of pose and shape. First a grid over the
tip's place along the shaft and the bevel's roll, then the cross-entropy method (Rubinstein 1999), then
importance sampling for mean and covariance. Neighbouring voxels share speckle, so the evidence is tempered.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.needle_scores import needle_scores
from haptigraph.perception.volume.bevelled import (
    ALONG,
    BEVEL,
    COUNT,
    LEAN,
    RADIUS,
    ROLL,
    TURN,
    Frame,
    pose_of,
    rows_of,
)
from haptigraph.perception.volume.light import MOST, TissueProfile, light_stops
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft_line import RADIUS_MM, ShaftLine
from haptigraph.perception.volume.surfaces import SurfaceMaps

__all__ = ["NeedleFit", "fit_needle"]

BEHIND_MM, AHEAD_MM, BESIDE_MM = 0.8, 0.26, 0.13  # extent of the A-scans around the end of the shadow
THIN_MM = -0.25  # up to here, every second A-scan is enough
SHAFT_MM = -0.16  # up to here the cylinder is whole, whatever the bevel
GRID_MM = np.arange(-0.14, 0.22, 0.02)
ROLLS = np.arange(12) * (2 * math.pi / 12)
BEVEL_RAD, BEVEL_SD_RAD = math.radians(27.0), math.radians(6.0)
RADIUS_SD_MM = 0.012
USUAL_SHAFT_MM = 0.8  # a shorter shaft gives a less certain direction
SHAFT_SD = np.array([1e-4, 0.012, 0.012, 0.014, 0.02, 1e-4, 0.006, 1e-4])
START_SD = np.array([0.02, 0.006, 0.006, 0.006, 0.008, 0.4, 0.003, 0.08])
LEAST_SD = np.array([0.003, 0.001, 0.001, 0.001, 0.0015, 0.05, 0.0005, 0.02])
SHAFT_DRAWS, DRAWS, SHAFT_ROUNDS, ROUNDS, MODES, SAMPLES, SEED = 50, 110, 5, (3, 3), 3, 400, 6
TEMPERATURE = 6.0  # voxels that share speckle count as one
BEAM_MM = np.array([[-0.004, -0.008], [0.004, 0.008], [-0.004, 0.008], [0.004, -0.008]])  # x, z
INSET_MM, AHEAD_SHARE = 0.0017, 1.4  # light passes twice: a shadow's half level is inside the metal's edge
SD_FACTOR, LEAST_TIP_SD_MM = 1.1, 0.004  # calibrated on simulated volumes
DIRECTION_FACTOR, LEAST_DIRECTION_SD_DEG = 1.2, 0.15
ROLL_MARGIN = 110.0  # below the best roll, at which another is not tried
LEAST_DRAWS = 15.0  # that count in a mean
MODE_MARGIN = 8.0  # below the best mode, tempered, at which another is dropped
HALF_BEAM_MM = np.ascontiguousarray(BEAM_MM[:2])
NO_BEAM = np.zeros((1, 2))


class NeedleFit(NamedTuple):
    """Posterior of a needle's pose."""

    tip_mm: Floats
    """The sharp end, (3,)."""
    tip_cov_mm2: Floats
    """(3, 3)."""
    axis_mm: Floats
    """The point of the axis beside the tip, (3,)."""
    along: Floats
    """Direction of the axis towards the tip, (3,)."""
    direction_sd_deg: float
    radius_mm: float
    facing: Floats
    """Mean direction to which the bevel opens; shorter than 1 where it is uncertain, (3,)."""
    score: float
    """Mean evidence of the A-scans on the needle, 1 at most."""


class _Evidence(NamedTuple):
    at: Floats
    """x, z and weight of the A-scans, (m, 3): some stand for their neighbours too."""
    stops: FloatImage
    """(m, h), contiguous."""
    axial_mm: float

    def part(self, chosen: Mask) -> "_Evidence":
        """Return some of the A-scans."""
        at, stops = np.ascontiguousarray(self.at[chosen]), np.ascontiguousarray(self.stops[chosen])
        return _Evidence(at, stops, self.axial_mm)

    def mean_score(self, frame: Frame, parameters: Floats) -> float:
        """Return the evidence of the A-scans on a needle as a share of the most possible."""
        everywhere = self._replace(stops=np.ones_like(self.stops))
        count = max(float(everywhere.scores(frame, parameters, NO_BEAM)[0]), 1.0)
        return float(self.scores(frame, parameters, NO_BEAM)[0]) / (MOST * count)

    def scores(self, frame: Frame, parameters: Floats, beam_mm: Floats) -> Floats:
        """Return the log-likelihood ratio of every pose, (p,)."""
        poses = rows_of(pose_of(frame, parameters), parameters)
        return needle_scores(self.at, self.stops, self.axial_mm, poses, beam_mm)


def fit_needle(
    volume: Image, scale: VolumeScale, maps: SurfaceMaps, profile: TissueProfile, line: ShaftLine
) -> NeedleFit:
    """Fit a needle.

    Args:
        volume: (h, n, w) grey.
        scale: Its size and scale.
        maps: Surfaces.
        profile: Brightness of tissue.
        line: The shaft.
    """
    frame = _frame(line)
    evidence, is_shaft = _evidence(volume, scale, maps, profile, line)
    rng = np.random.default_rng(SEED)
    mean = np.zeros(COUNT)
    mean[ALONG], mean[RADIUS], mean[BEVEL] = 1.0, RADIUS_MM, BEVEL_RAD  # the tip is far ahead
    shaft = evidence.part(is_shaft)
    sd = SHAFT_SD.copy()
    sd[[LEAN, TURN]] *= max(1.0, USUAL_SHAFT_MM / (line.last_mm - line.first_mm))
    mean, _ = _cross_entropy(shaft, frame, mean, np.diag(sd**2), rng, SHAFT_DRAWS, SHAFT_ROUNDS)
    grid = np.tile(mean, (len(GRID_MM) * len(ROLLS), 1))
    grid[:, ALONG], grid[:, ROLL] = np.repeat(GRID_MM, len(ROLLS)), np.tile(ROLLS, len(GRID_MM))
    coarse = evidence.scores(frame, grid, NO_BEAM).reshape(len(GRID_MM), len(ROLLS))
    modes = [
        (grid[coarse[:, roll].argmax() * len(ROLLS) + roll], np.diag(START_SD**2))
        for roll in _modes(coarse.max(axis=0))
    ]
    for rounds in ROUNDS:
        modes = [_cross_entropy(evidence, frame, *mode, rng, DRAWS, rounds) for mode in modes]
        modes = _best_modes(evidence, frame, modes)
    return _posterior_moments(evidence, frame, modes, rng)


def _modes(scores: Floats) -> list[int]:
    """Return the rolls with the best scores that are not neighbours."""
    chosen: list[int] = []
    for roll in np.argsort(-scores):
        if scores[roll] > scores.max() - ROLL_MARGIN and all(
            min((roll - one) % len(ROLLS), (one - roll) % len(ROLLS)) > 2 for one in chosen
        ):
            chosen.append(int(roll))
    return chosen[:MODES]


def _cross_entropy(
    evidence: "_Evidence",
    frame: Frame,
    mean: Floats,
    cov: Floats,
    rng: np.random.Generator,
    draws: int,
    rounds: int,
) -> tuple[Floats, Floats]:
    """Return mean and covariance of the best draws."""
    least = np.diag(np.minimum(LEAST_SD**2, np.diag(cov)))
    for _ in range(rounds):
        some = mean + rng.standard_normal((draws, COUNT)) @ np.linalg.cholesky(cov).T
        some[0] = mean
        score = _posterior(evidence, frame, some, HALF_BEAM_MM)
        elite = some[np.argsort(-score)[: draws // 5]]
        mean = elite.mean(axis=0)
        cov = 0.8 * np.cov(elite.T) + 0.1 * cov + least
    return mean, cov


def _best_modes(
    evidence: "_Evidence", frame: Frame, modes: list[tuple[Floats, Floats]]
) -> list[tuple[Floats, Floats]]:
    """Return the modes that are nearly as good as the best."""
    means = np.array([mean for mean, _ in modes])
    score = _posterior(evidence, frame, means, BEAM_MM)
    return [mode for mode, one in zip(modes, score, strict=True) if one > score.max() - MODE_MARGIN]


def _frame(line: ShaftLine) -> Frame:
    lean, turn = math.atan(-line.slope), math.atan2(line.along[1], line.along[0])
    ridge_mm = line.at_mm + line.shadow_mm * np.array([line.along[0], line.slope, line.along[1]])
    return Frame(ridge_mm - np.array([0.0, RADIUS_MM / math.cos(lean), 0.0]), lean, turn)


def _evidence(
    volume: Image, scale: VolumeScale, maps: SurfaceMaps, profile: TissueProfile, line: ShaftLine
) -> tuple[_Evidence, Mask]:
    z, x = np.meshgrid(scale.z_mm, scale.x_mm, indexing="ij")
    off_x, off_z = x - line.at_mm[0], z - line.at_mm[2]
    s = off_x * line.along[0] + off_z * line.along[1] - line.shadow_mm
    across = off_z * line.along[0] - off_x * line.along[1]
    near = (s > -BEHIND_MM) & (s < AHEAD_MM) & (np.abs(across) < BESIDE_MM)
    near[:, 1::2] &= s[:, 1::2] > THIN_MM  # the shaft needs fewer A-scans than the tip
    number, column = np.nonzero(near)
    x_mm, z_mm = x[number, column], z[number, column]
    rows = tuple(scale.row(surface.at(x_mm, z_mm)) for surface in (maps.ilm, maps.rpe))
    stops = light_stops(volume, scale, (number, column), (rows[0], rows[1]), profile)
    behind = s[number, column]
    at = np.stack([x_mm, z_mm, np.where(behind > THIN_MM, 1.0, 2.0)], axis=1)
    evidence = _Evidence(at, np.ascontiguousarray(stops.T), scale.axial_mm)
    return evidence, behind < SHAFT_MM


def _posterior(evidence: _Evidence, frame: Frame, draws: Floats, beam_mm: Floats) -> Floats:
    draws[:, RADIUS] = np.clip(draws[:, RADIUS], 0.02, 0.3)
    draws[:, BEVEL] = np.clip(draws[:, BEVEL], 0.12, 1.4)
    prior = ((draws[:, BEVEL] - BEVEL_RAD) / BEVEL_SD_RAD) ** 2
    prior = prior + ((draws[:, RADIUS] - RADIUS_MM) / RADIUS_SD_MM) ** 2
    return evidence.scores(frame, draws, beam_mm) / TEMPERATURE - prior / 2


def _posterior_moments(
    evidence: _Evidence,
    frame: Frame,
    modes: list[tuple[Floats, Floats]],
    rng: np.random.Generator,
) -> NeedleFit:
    """Weigh draws from a mixture of normal distributions, one for each mode."""
    kept = [(mean, 1.5 * cov) for mean, cov in modes]
    each = SAMPLES // len(kept)
    draws = np.concatenate(
        [mean + rng.standard_normal((each, COUNT)) @ np.linalg.cholesky(cov).T for mean, cov in kept]
    )
    density = np.logaddexp.reduce([_log_normal(draws, mean, cov) for mean, cov in kept])
    score = _posterior(evidence, frame, draws, BEAM_MM)
    weight = _weights(score - density)
    pose = pose_of(frame, draws)
    tips_mm = pose.tip_mm + INSET_MM * (AHEAD_SHARE * pose.along - pose.facing)
    tip_mm, axis_mm = weight @ tips_mm, weight @ pose.axis_mm
    off = tips_mm - tip_mm
    along = weight @ pose.along
    along /= np.linalg.norm(along)
    spread = weight @ ((pose.along - along) ** 2).sum(axis=1)
    return NeedleFit(
        tip_mm,
        (SD_FACTOR * off * weight[:, None]).T @ (SD_FACTOR * off) + LEAST_TIP_SD_MM**2 * np.eye(3),
        axis_mm,
        along,
        math.hypot(DIRECTION_FACTOR * math.degrees(math.sqrt(spread / 2)), LEAST_DIRECTION_SD_DEG),
        float(weight @ draws[:, RADIUS]) + INSET_MM,
        weight @ pose.facing,
        evidence.mean_score(frame, draws[[int(score.argmax())]]),
    )


def _weights(log_weight: Floats) -> Floats:
    """Return normalized weights, tempered until enough draws count."""
    share = 1.0
    while True:
        weight = np.exp(share * (log_weight - log_weight.max()))
        weight /= weight.sum()
        if 1 / float(weight @ weight) >= LEAST_DRAWS:
            return np.asarray(weight, np.float64)
        share *= 0.8


def _log_normal(draws: Floats, mean: Floats, cov: Floats) -> Floats:
    root = np.linalg.cholesky(cov)
    normal = np.linalg.solve(root, (draws - mean).T)
    return np.asarray(-0.5 * (normal**2).sum(axis=0) - np.log(np.diag(root)).sum(), np.float64)
