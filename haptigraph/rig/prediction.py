"""The registration that a rig's design predicts, and how far tolerances may move it [px].

The standard deviations are those of rigs drawn from the tolerances, each seen as built.
"""

from collections.abc import Iterable

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.registration.text import AnatomyPx, TrocarPx
from haptigraph.rig.description import Rig
from haptigraph.rig.view import Build, View, as_designed, drawn, retina_points

__all__ = ["DRAWS", "Angles", "Observed", "Prediction", "observe", "predict", "predicted_anatomy", "vec_of"]

DRAWS, SEED = 2000, 34
SIDES = "left", "right"


class Observed(Struct, frozen=True, eq=False):
    """What registrations of n rigs as built find, without any error of the registration."""

    center_px: Floats
    """(n, 2): the globe's centre."""
    radius_px: Floats
    """(n,): of the globe, in the frontal view."""
    roll_deg: Floats
    """(n,): how far the eye appears turned, clockwise in the image."""
    tilt_deg: Floats
    """(n, 2): right and down, as in `CameraTilt`."""
    retina_px: Floats
    """(n, m, 2)."""
    target_px: Floats
    """(n, 2)."""
    ports_px: Floats
    """(n, 2, 2)."""
    angles_deg: Floats
    """(n, 3): of ports, from the top, and target, from the bottom; about the centre, clockwise."""
    rim_ratio: Floats
    """(n,): apparent size of the cut edge relative to the section."""
    wall_ratio: Floats
    """(n,): outer over inner radius of the cut face."""
    closeness: Floats
    """(n,): radius of the globe over its distance from the camera."""


class Angles(Struct, frozen=True, eq=False):
    """Normal distribution of `Observed.angles_deg`: eyes are turned as a whole, each print has its error."""

    mean_deg: Floats
    """(3,)."""
    cov_deg2: Floats
    """(3, 3)."""

    @property
    def sd_deg(self) -> Floats:
        """Standard deviations, (3,)."""
        return np.sqrt(np.diag(self.cov_deg2))

    @property
    def ports_deg(self) -> tuple[tuple[float, float], ...]:
        """Angle and standard deviation of each port."""
        return tuple(zip(self.mean_deg[:-1].tolist(), self.sd_deg[:-1].tolist(), strict=True))

    @property
    def target_deg(self) -> tuple[float, float]:
        """Angle and standard deviation of the target."""
        return float(self.mean_deg[-1]), float(self.sd_deg[-1])

    def given(self, measured: Iterable[tuple[int, float, float]]) -> "Angles":
        """Return the distribution given measurements, each weighed by its inverse variance.

        Args:
            measured: Number of the angle, its value and its standard deviation [deg]; errors are independent.
        """
        mean_deg, cov_deg2 = self.mean_deg, self.cov_deg2
        for number, at_deg, sd_deg in measured:
            gain = cov_deg2[number] / (cov_deg2[number, number] + sd_deg**2)
            mean_deg = mean_deg + gain * (at_deg - mean_deg[number])
            cov_deg2 = cov_deg2 - np.outer(gain, cov_deg2[number])
        return Angles(mean_deg, cov_deg2)


class Prediction(Struct, frozen=True, eq=False):
    """What a registration of the rig is expected to find."""

    rig: Rig
    expected: Observed
    """As designed, n = 1."""
    sd: Observed
    """Standard deviations over rigs drawn from the tolerances, n = 1."""
    angles: Angles
    """Of ports and target, over the same rigs."""

    @property
    def mm_per_px(self) -> float:
        """Scale of the section in the image."""
        return self.rig.eye.diameter_mm / 2 / float(self.expected.radius_px[0])


def observe(rig: Rig, build: Build) -> Observed:
    """Return what registrations of rigs as built find."""
    view, eye = View(rig, build), rig.eye
    cut_mm = eye.cut_mm + build.cut_mm
    radius_mm = eye.diameter_mm / 2 + build.radius_mm
    inner_mm, outer_mm = (np.sqrt((radius_mm + wall) ** 2 - cut_mm**2) for wall in (0.0, eye.wall_mm))
    depth_mm = view.center_depth_mm
    center_px, target_px, ports_px = (
        view.to_px(points_mm) for points_mm in (np.zeros((1, 3)), view.target_mm, view.ports_mm)
    )
    from_top, from_bottom = ports_px - center_px, center_px - target_px
    right_up = np.concatenate([from_top, from_bottom], axis=1) * (1, -1)
    return Observed(
        center_px=center_px[:, 0],
        radius_px=view.focal_px * radius_mm / depth_mm,
        roll_deg=view.roll_deg,
        tilt_deg=view.tilt_deg,
        retina_px=view.to_px(view.on_globe(retina_points(rig))),
        target_px=target_px[:, 0],
        ports_px=ports_px,
        angles_deg=np.degrees(np.arctan2(right_up[..., 0], right_up[..., 1])),
        rim_ratio=inner_mm / radius_mm * depth_mm / (depth_mm - cut_mm),
        wall_ratio=outer_mm / inner_mm,
        closeness=radius_mm / depth_mm,
    )


def predict(rig: Rig) -> Prediction:
    """Predict what a registration of a rig finds, with standard deviations."""
    many = observe(rig, drawn(rig, DRAWS, SEED))
    spread = {name: getattr(many, name).std(axis=0, keepdims=True) for name in many.__struct_fields__}
    expected = observe(rig, as_designed())
    angles = Angles(expected.angles_deg[0], np.cov(many.angles_deg.T, ddof=0))
    return Prediction(rig, expected, Observed(**spread), angles)


def predicted_anatomy(rig: Rig, observed: Observed) -> AnatomyPx:
    """Return the registration of one rig, n = 1; without homography, as a frontal camera sees it."""
    ports = zip(rig.eye.trocars_deg, observed.ports_px[0], strict=True)
    trocars = tuple(
        TrocarPx(SIDES[angle_deg > 0], vec_of(point_px), used=not number)
        for number, (angle_deg, point_px) in enumerate(ports)
    )
    if trocars[0].name == trocars[1].name:
        trocars = trocars[0], replace(trocars[1], name=f"{trocars[1].name} 2")
    return AnatomyPx(
        width_px=rig.camera.width_px,
        height_px=rig.camera.height_px,
        mirrored=rig.mirrored,
        center_px=vec_of(observed.center_px[0]),
        radius_px=float(observed.radius_px[0]),
        diameter_mm=rig.eye.diameter_mm,
        contour_px=tuple(vec_of(point_px) for point_px in observed.retina_px[0]),
        target_px=vec_of(observed.target_px[0]),
        trocars=trocars,
    )


def vec_of(point: Floats) -> Vec:
    """Return a point, (2,), as a pair."""
    return float(point[0]), float(point[1])
