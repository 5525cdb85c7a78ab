"""Calibrate a robot: pairs of points, or tips in images and of the robot -> where the eye is in its base."""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.robot.place.autocorrelation import values_per_independent
from haptigraph.robot.place.pivot import Pivot
from haptigraph.robot.place.rigid_fit import MAD_TO_SD, RigidFit, fit_points, procrustes
from haptigraph.robot.pose import Floats
from haptigraph.robot.setup import EyePlace, MotionLimits, RcmPlace, RobotSetup

__all__ = [
    "Calibration",
    "calibrate_points",
    "calibrate_section",
    "leave_one_out_mm",
    "pose_noise_mm",
    "rcm_of",
    "setup_text",
]

MAX_RMS_MM = 0.5
"""Largest RMS residual that is accepted."""
MAX_DEPTH_MM = 0.5  # RMS, by which a motion may leave its plane
MIN_TIPS = 60
PARAMETERS = 6
LEAST_SD_MM = 1e-3
SLOW = 0.25
THIRD_DIFFERENCE = math.sqrt(20.0)  # sd of a third difference, over that of one value: 1, -3, 3, -1


class Calibration(Struct, frozen=True):
    """Where the eye is, and how well that is known."""

    fit: RigidFit
    target_mm: Floats
    """For which `tip_sd_mm` is stated, eye frame."""
    notes: tuple[str, ...]
    """What was not determined or not checked, a sentence each."""
    pose_sd_mm: float
    """Standard deviation of one pose of the robot, per axis."""
    axes: int = 3
    """How many axes of the eye frame were measured: in the section, x and y."""

    @property
    def eye(self) -> EyePlace:
        """The [eye] table."""
        pose = self.fit.eye_from_base.inverse().as_pose()
        return EyePlace(pose.position_mm, pose.quaternion, self.fit.rms_mm, self.tip_sd_mm)

    @property
    def target_sd_mm(self) -> float:
        """Standard deviation of the transform at the target, per measured axis."""
        return self.fit.sd_at_mm(self.target_mm, self.axes)

    @property
    def tip_sd_mm(self) -> float:
        """Standard deviation of the robot's tip at the target, per measured axis: transform and pose."""
        return math.hypot(self.target_sd_mm, self.pose_sd_mm)


def calibrate_points(
    base_mm: Floats, eye_mm: Floats, sd_mm: float, target_mm: Floats, what: str
) -> Calibration:
    """Calibrate from touched points.

    Args:
        base_mm: The robot's tip at each point, in its base, (n, 3).
        eye_mm: The points in the eye frame, (n, 3).
        sd_mm: Standard deviation of one pair, per axis.
        target_mm: Where the tip will be used, eye frame.
        what: Names the points in errors.

    Raises:
        BadInput: If the points do not determine the transform.
    """
    fit = fit_points(base_mm, eye_mm, np.full(len(base_mm), sd_mm), max_rms_mm=MAX_RMS_MM, what=what)
    return Calibration(fit, target_mm, _notes(fit), fit.noise_mm)


def calibrate_section(
    base_mm: Floats,
    image_mm: Floats,
    image_sd_mm: Floats,
    pose_sd_mm: float,
    target_mm: Floats,
    what: str,
) -> Calibration:
    """Calibrate from tips in images, of a motion in the section z = 0.

    Neighbouring errors of a tracker resemble each other, so the covariance is that of as many pairs as are
    independent. The variance that the tips' own does not explain is ascribed to the robot.

    Args:
        base_mm: The robot's tip at the time of each image, in its base, (n, 3).
        image_mm: The tips in the images, eye frame, (n, 2).
        image_sd_mm: Their standard deviations, per axis, (n,).
        pose_sd_mm: Standard deviation of one pose of the robot, at least, per axis.
        target_mm: Where the tip will be used, eye frame.
        what: Names the run in errors.

    Raises:
        BadInput: If the motion does not determine the transform.
    """
    if len(base_mm) < MIN_TIPS:
        raise BadInput(f"{len(base_mm)} images with a tip are too few; at least {MIN_TIPS} are needed", what)
    centred = base_mm - base_mm.mean(axis=0)
    depth_mm = float(np.linalg.svd(centred, compute_uv=False)[2]) / math.sqrt(len(base_mm))
    if depth_mm > MAX_DEPTH_MM:
        raise BadInput(
            f"the motion leaves its plane by {depth_mm:.2f} mm RMS, and images show no depth; move in the "
            "section, or touch points",
            what,
        )
    eye_mm = np.column_stack((image_mm, np.zeros(len(image_mm))))
    sd_mm = np.maximum(image_sd_mm, _rough_sd_mm(base_mm, eye_mm))
    fit = fit_points(base_mm, eye_mm, sd_mm, max_rms_mm=MAX_RMS_MM, what=what)
    in_section = fit.residual_mm[fit.used > 0, :2]
    independent = len(in_section) / values_per_independent(in_section)
    if independent < 2 * PARAMETERS:
        raise BadInput(
            f"the residuals of {len(in_section)} images are worth only {independent:.0f} independent ones; "
            "record a longer run",
            what,
        )
    factor = len(in_section) / (independent - PARAMETERS)
    noise_mm = math.sqrt(float((in_section**2).mean()))
    # The covariance of `fit_points` is for its own noise; that in the section is what was measured.
    scale = factor * (noise_mm / fit.noise_mm) ** 2
    fit = replace(fit, covariance=fit.covariance * scale, noise_mm=noise_mm)
    assumed = (
        "assumed: the motion lay in the section z = 0; images show no depth, so z and tilt are not measured"
    )
    unexplained_mm2 = noise_mm**2 - float((image_sd_mm[fit.used > 0] ** 2).mean())
    pose_sd_mm = math.sqrt(max(unexplained_mm2, pose_sd_mm**2))
    return Calibration(fit, target_mm, (assumed, *_notes(fit)), pose_sd_mm, axes=2)


def pose_noise_mm(times_s: Floats, tips_mm: Floats) -> float:
    """Return the standard deviation per axis of the noise of a robot's tips, which changes with each sample.

    From third differences, which remove a smooth motion, of the slowest quarter of the samples: stamps with
    jitter matter less there.

    Args:
        times_s: Stamps, increasing, (n,).
        tips_mm: (n, 3).
    """
    speed_mm_s = np.linalg.norm(tips_mm[3:] - tips_mm[:-3], axis=1) / (times_s[3:] - times_s[:-3])
    slow = speed_mm_s <= np.quantile(speed_mm_s, SLOW)
    third_mm = np.diff(tips_mm, 3, axis=0)[slow] / THIRD_DIFFERENCE
    sd_mm = MAD_TO_SD * np.median(np.abs(third_mm), axis=0)
    return math.sqrt(float((sd_mm**2).mean()))


def _rough_sd_mm(base_mm: Floats, eye_mm: Floats) -> float:
    """Return the standard deviation of most pairs, per axis of the section, whatever is stated."""
    residual_mm = procrustes(base_mm, eye_mm, np.ones(len(base_mm))).residual_mm[:, :2]
    return max(MAD_TO_SD * float(np.median(np.abs(residual_mm))), LEAST_SD_MM)


def leave_one_out_mm(base_mm: Floats, eye_mm: Floats, fit: RigidFit) -> Floats:
    """Return how far each used point is from the fit of all others, (n used,)."""
    used = fit.used > 0
    base_mm, eye_mm, weight = base_mm[used], eye_mm[used], np.ones(int(used.sum()))
    distances = []
    for number in range(len(base_mm)):
        others = weight.copy()
        others[number] = 0.0
        residual = procrustes(base_mm, eye_mm, others).residual_mm[number]
        distances.append(float(np.linalg.norm(residual)))
    return np.array(distances)


def setup_text(
    eye: EyePlace, rcm: RcmPlace, kept: RobotSetup | None, shaft_axis: str, title: str, notes: tuple[str, ...]
) -> str:
    """Return the text of robot.toml.

    Args:
        eye: The [eye] table.
        rcm: The [rcm] table.
        kept: An earlier file, whose limits are kept; None: there is none.
        shaft_axis: Axis of the tool's frame along the shaft.
        title: The first comment.
        notes: Further comments, a sentence each.
    """
    lines = [f"# {one}" for one in (title, *notes)]
    lines += ["", "format = 1", f'shaft_axis = "{shaft_axis}"', "", "[rcm]", f"at_mm = {_list(rcm.at_mm)}"]
    lines += [f"sd_mm = {rcm.sd_mm:.4g}"] if rcm.sd_mm is not None else []
    lines += ["", "[eye]", f"translation_mm = {_list(eye.translation_mm)}"]
    lines += [f"quaternion = {_list(eye.quaternion, 12)}"]
    uncertainty = {"residual_rms_mm": eye.residual_rms_mm, "tip_sd_mm": eye.tip_sd_mm}
    lines += [f"{name} = {value:.4g}" for name, value in uncertainty.items() if value is not None]
    if kept is not None and kept.limits != MotionLimits():
        lines += ["", "[limits]"]
        for name in MotionLimits.__struct_fields__:
            if (value := getattr(kept.limits, name)) != getattr(MotionLimits(), name):
                lines.append(f"{name} = {value:g}")
    return "\n".join(lines) + "\n"


def rcm_of(pivot: Pivot) -> RcmPlace:
    """Return a pivot as the [rcm] table."""
    x, y, z = pivot.at_mm.tolist()
    return RcmPlace((x, y, z), pivot.sd_mm)


def _notes(fit: RigidFit) -> tuple[str, ...]:
    if not fit.is_planar:
        return ()
    return (
        "not checked: all points lie in one plane, so a robot whose frame is left-handed would fit as well",
    )


def _list(numbers: tuple[float, ...], digits: int = 9) -> str:
    return f"[{', '.join(f'{number:.{digits}g}' for number in numbers)}]"
