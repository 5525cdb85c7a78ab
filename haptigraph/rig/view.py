"""What a rig's camera sees, as designed or as built: where points of the eye appear in its image [px].

The mirror is a plane: the camera that looks into it sees what its own reflection sees. Turned "down", the
camera lies below the mirror and looks up; the rule for its top is the same for every turn: the reflection of
the eye's top. So the image has the eye's top on top, and left and right exchanged.
"""

import math

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.imaging import Floats
from haptigraph.rig.description import Mirror, Rig

__all__ = ["Build", "View", "as_designed", "drawn", "retina_points"]

TURNS = {"up": (0.0, 1.0, 0.0), "down": (0.0, -1.0, 0.0), "left": (-1.0, 0.0, 0.0), "right": (1.0, 0.0, 0.0)}
RETINA_STEP_DEG = 1.5


class Build(Struct, frozen=True, eq=False):
    """How rigs as built differ from the design; one row for each of n rigs."""

    camera_mm: Floats
    """(n, 3): shift of the camera along its own right, up and back."""
    camera_deg: Floats
    """(n, 3): its rotation vector about these axes."""
    mirror_mm: Floats
    """(n, 3): shift of the mirror, eye frame."""
    mirror_deg: Floats
    """(n, 3): its rotation vector, eye frame."""
    eye_mm: Floats
    """(n, 3): shift of the eye."""
    radius_mm: Floats
    """(n,): of the globe's inner surface, beyond the designed one."""
    cut_mm: Floats
    """(n,): of the cut face, towards the camera."""
    along_mm: Floats
    """(n, 3): of the target and the two ports, along the globe's wall, counted as their angles are."""
    focal_ratio: Floats
    """(n,): focal length relative to the data sheet's."""
    principal_px: Floats
    """(n, 2): shift of the principal point, right and down."""

    def row(self, number: int) -> "Build":
        """Return one of the rigs, n = 1."""
        return Build(*(getattr(self, name)[number : number + 1] for name in self.__struct_fields__))


def as_designed() -> Build:
    """Return the rig that is exactly as designed, n = 1."""
    one, three = np.zeros(1), np.zeros((1, 3))
    return Build(three, three, three, three, three, one, one, three, one + 1, np.zeros((1, 2)))


def drawn(rig: Rig, count: int, seed: int) -> Build:
    """Draw rigs from a design's tolerances.

    Args:
        rig: The design.
        count: How many.
        seed: Of the draws; the same seed gives the same rigs.
    """
    random, tolerances = np.random.default_rng(seed), rig.tolerances

    def normal(sd: float, *columns: int) -> Floats:
        return random.normal(0.0, sd, (count, *columns))

    position_mm, angle_deg, print_mm = tolerances.position_mm, tolerances.angle_deg, tolerances.print_mm
    return Build(
        camera_mm=normal(position_mm, 3),
        camera_deg=normal(angle_deg, 3),
        mirror_mm=normal(position_mm, 3),
        mirror_deg=normal(angle_deg, 3),
        eye_mm=normal(position_mm, 3),
        radius_mm=normal(print_mm),
        cut_mm=normal(print_mm),
        along_mm=normal(print_mm, 3),
        focal_ratio=1 + normal(tolerances.focal_percent / 100),
        principal_px=normal(tolerances.principal_percent / 100 * rig.camera.width_px, 2),
    )


def retina_points(rig: Rig) -> Floats:
    """Return angles of points on the retina, from the surgeon's left over the bottom to the right [rad]."""
    half_deg = rig.eye.retina_half_deg
    return np.radians(np.linspace(-half_deg, half_deg, round(2 * half_deg / RETINA_STEP_DEG) + 1))


class View:
    """The cameras of n rigs as built, and what they see.

    Args:
        rig: The design.
        build: How the rigs differ from it.
    """

    def __init__(self, rig: Rig, build: Build) -> None:
        self._rig, self._build = rig, build
        count = len(build.focal_ratio)
        mirrors = [_reflection(np.array([_normal(mirror)])) for mirror in rig.mirrors]
        fold = mirrors[0][0] if mirrors else np.eye(3)
        pivot_mm = np.array([0, 0, rig.mirrors[0].from_section_mm if rig.mirrors else 0.0])
        eye_from_camera = fold @ np.diag([-1.0 if rig.mirrored else 1.0, 1.0, 1.0])
        position_mm = pivot_mm + fold @ (np.array([0, 0, rig.path_mm]) - pivot_mm)
        self.camera_axes = eye_from_camera @ _rotations(build.camera_deg)
        """(n, 3, 3): columns are the camera's right, up and back, eye frame."""
        self.camera_mm = position_mm + build.camera_mm @ eye_from_camera.T
        """(n, 3): the entrance pupils."""
        self.mirror_mm = pivot_mm + build.mirror_mm
        """(n, 3): centres of the mirrors; without a mirror they mean nothing."""
        self.mirror_normal = np.array(
            [
                rotation @ (_normal(rig.mirrors[0]) if rig.mirrors else (0, 0, 1))
                for rotation in _rotations(build.mirror_deg)
            ]
        )
        """(n, 3): of the reflecting side."""
        flips = _reflection(self.mirror_normal) if rig.mirrors else np.tile(np.eye(3), (count, 1, 1))
        self.seen_axes = flips @ self.camera_axes
        """(n, 3, 3): the axes of the camera's reflection, which faces the section."""
        self.seen_mm = (
            self.mirror_mm + np.einsum("nij,nj->ni", flips, self.camera_mm - self.mirror_mm)
            if rig.mirrors
            else self.camera_mm
        )
        """(n, 3): the reflections of the entrance pupils."""

    @property
    def focal_px(self) -> Floats:
        """Focal lengths, (n,)."""
        return self._rig.camera.focal_px * self._build.focal_ratio

    @property
    def principal_px(self) -> Floats:
        """Principal points, (n, 2)."""
        camera = self._rig.camera
        return np.array([camera.width_px - 1, camera.height_px - 1]) / 2 + self._build.principal_px

    def to_px(self, points_mm: Floats) -> Floats:
        """Project points into the images.

        Args:
            points_mm: (n, m, 3) or (m, 3), in a frame that moves with the eye.

        Returns:
            (n, m, 2).
        """
        seen = self._in_camera(points_mm)
        share = self.focal_px[:, None, None] / -seen[..., 2:]
        right_down = seen[..., :2] * np.array([1.0, -1.0])
        return np.asarray(self.principal_px[:, None] + share * right_down)

    def on_globe(self, angles: Floats, off_mm: float = 0.0, z_mm: float = 0.0) -> Floats:
        """Return points around the globe as printed, (n, m, 3).

        Args:
            angles: (m,) or (n, m): from the bottom, positive to the surgeon's right [rad].
            off_mm: Distance outwards from the inner surface.
            z_mm: Height above the section of the plane that the points lie in.
        """
        radius_mm = self._rig.eye.diameter_mm / 2 + self._build.radius_mm[:, None] + off_mm
        ring_mm = np.sqrt(radius_mm**2 - z_mm**2)
        right, up = ring_mm * np.sin(angles), -ring_mm * np.cos(angles)
        return np.stack([right, up, np.full_like(right, z_mm)], axis=-1)

    @property
    def target_mm(self) -> Floats:
        """The targets as printed, (n, 1, 3)."""
        eye = self._rig.eye
        angle = math.radians(eye.target_deg) + self._build.along_mm[:, :1] / (eye.diameter_mm / 2)
        return self.on_globe(angle)

    @property
    def ports_mm(self) -> Floats:
        """The two ports in the middle of the wall as printed, (n, 2, 3)."""
        eye = self._rig.eye
        from_top = np.radians(eye.trocars_deg) + self._build.along_mm[:, 1:] / (eye.diameter_mm / 2)
        return self.on_globe(math.pi - from_top, eye.wall_mm / 2)

    @property
    def center_depth_mm(self) -> Floats:
        """From the pupils to the globe's centre, along the optical axis, (n,)."""
        return np.asarray(-self._in_camera(np.zeros((1, 3)))[:, 0, 2])

    @property
    def tilt_deg(self) -> Floats:
        """Components (right, down) of the angle between section and sensor, as in `CameraTilt`, (n, 2)."""
        normal = self.seen_axes[:, 2]  # the section's normal in the camera's axes
        across = normal[:, :2] * np.array([1.0, -1.0])
        sine = np.hypot(across[:, 0], across[:, 1])
        angle = np.degrees(np.arctan2(sine, normal[:, 2]))
        return np.asarray(across * (angle / np.maximum(sine, 1e-12))[:, None])

    @property
    def roll_deg(self) -> Floats:
        """How far the eye appears turned, clockwise in the image, (n,)."""
        up = self.seen_axes[:, 1]  # the eye's up in the camera's axes
        return np.degrees(np.arctan2(up[:, 0], up[:, 1]))

    def _in_camera(self, points_mm: Floats) -> Floats:
        from_pupil_mm = points_mm + (self._build.eye_mm - self.seen_mm)[:, None]
        return np.asarray(from_pupil_mm @ self.seen_axes)


def _normal(mirror: Mirror) -> tuple[float, float, float]:
    """Return the normal of a mirror's reflecting side: between the section and the camera."""
    angle, (right, up, _) = math.radians(mirror.angle_deg), TURNS[mirror.turns]
    return right * math.sin(angle), up * math.sin(angle), -math.cos(angle)


def _reflection(normals: Floats) -> Floats:
    """Return the reflections at planes through the origin, (n, 3, 3)."""
    return np.asarray(np.eye(3) - 2 * normals[:, :, None] * normals[:, None, :])


def _rotations(vectors_deg: Floats) -> Floats:
    """Return the rotations by rotation vectors, (n, 3, 3)."""
    return np.array([cv2.Rodrigues(vector)[0] for vector in np.radians(vectors_deg)])
