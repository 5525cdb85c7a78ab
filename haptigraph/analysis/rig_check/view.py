"""What every subject looks at: the clip in the frontal view, its median image, and the rim found in it."""

import math
from functools import cached_property
from typing import TypeVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.rig_check.clip import Clip
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask, colored, tilt_corrected
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.moving_shaft import median_image
from haptigraph.perception.anatomy.port_opening import find_port_openings, polar_samples
from haptigraph.perception.anatomy.rim import Rim, visible_rim
from haptigraph.perception.anatomy.upright import moving_outside
from haptigraph.registration.camera import Registration

__all__ = ["View", "angle_from_top_deg", "view_of", "wrapped_deg"]

Angle = TypeVar("Angle", float, Floats)


class View(Struct, frozen=True, dict=True, eq=False):
    """A clip and its registration, both in the frontal view."""

    registration: Registration
    """Frontal."""
    clip: Clip
    spread: tuple[Image, ...]
    """The clip's spread images, frontal."""
    image: Image
    """Median of the images, BGR: the scene without what moves, (h, w, 3)."""
    rim: Rim | None
    problem: str
    """Why no rim was found; empty if one was."""

    @property
    def px_per_mm(self) -> float:
        """Registered scale."""
        return 1 / self.registration.image.mm_per_px

    @property
    def center_px(self) -> Vec:
        """Registered centre of the globe."""
        return self.registration.image.center_px

    @property
    def radius_px(self) -> float:
        """Registered radius of the globe."""
        return self.registration.globe.radius_mm * self.px_per_mm

    @property
    def found_center_px(self) -> Vec:
        """Centre of the rim that was found, else the registered one."""
        return self.rim.inner.center_px if self.rim else self.center_px

    @property
    def found_radius_px(self) -> float:
        """Radius of the rim that was found, else the registered one."""
        return self.rim.inner.radius_px if self.rim else self.radius_px

    @property
    def trocars_deg(self) -> tuple[float, ...]:
        """Registered angles of the trocars in the image, from the top, to its right; the used first."""
        trocars = self.registration.trocar, *self.registration.other_trocars
        points = (self.registration.image.to_px(trocar.at_mm) for trocar in trocars)
        return tuple(angle_from_top_deg(point, self.center_px) for point in points)

    @cached_property
    def ports_deg(self) -> tuple[float, ...]:
        """Angles of the port openings that are visible in the upper half, as `trocars_deg`."""
        return _ports_deg(self.image, self.rim)

    @cached_property
    def ports_below_deg(self) -> tuple[float, ...]:
        """The same in the image rotated by 180 degrees."""
        if self.rim is None:
            return ()
        rotated = np.ascontiguousarray(self.image[::-1, ::-1])
        return _ports_deg(rotated, Rim(_rotated(self.rim.inner, rotated), None))

    @cached_property
    def moving(self) -> Mask | None:
        """Where something moves just outside the eye, (h, w); None if hardly anything does."""
        return moving_outside(self.spread, self.image, self.rim) if self.rim else None

    @cached_property
    def reference_rim(self) -> Rim | None:
        """The rim in the registration's reference image without instrument; None if there is none."""
        background = self.registration.background
        return _rim_of(background.image)[0] if background else None

    def samples_at_deg(self, angles_deg: Floats, radii_px: Floats) -> Floats:
        """Sample the median image at angles from the top and radii about the rim found, (n, m, 3)."""
        return polar_samples(self.image, self.found_center_px, angles_deg, radii_px)


def view_of(clip: Clip, registration: Registration) -> View:
    """Prepare a clip for checking.

    Args:
        clip: The clip.
        registration: For its images.
    """
    homography = registration.image.frontal_from_image
    spread = tuple(tilt_corrected(each, homography) for each in clip.spread) if homography else clip.spread
    image = colored(median_image(spread))
    rim, problem = _rim_of(image)
    return View(registration.frontal, clip, spread, image, rim, problem)


def _rim_of(image: Image) -> tuple[Rim | None, str]:
    """Return the rim that is visible in an image, or why there is none."""
    try:
        return visible_rim(image), ""
    except BadInput as error:
        return None, error.problem


def angle_from_top_deg(point_px: Vec, center_px: Vec) -> float:
    """Return the direction of a point from a centre, from the top, positive to the image's right."""
    return math.degrees(math.atan2(point_px[0] - center_px[0], center_px[1] - point_px[1]))


def wrapped_deg(angle_deg: Angle) -> Angle:
    """Return an angle, or an array of them, from -180 to 180 degrees."""
    return (angle_deg + 180) % 360 - 180


def _rotated(edge: Edge, image: Image) -> Edge:
    """Return an edge as it is in the image rotated by 180 degrees."""
    (x, y), (height, width) = edge.center_px, image.shape[:2]
    return replace(
        edge,
        center_px=(width - 1 - x, height - 1 - y),
        harmonics_px=edge.harmonics_px * np.array([1, -1, -1, 1, 1]),
        angles=(edge.angles + math.pi) % (2 * math.pi),
    )


def _ports_deg(image: Image, rim: Rim | None) -> tuple[float, ...]:
    return tuple(each.angle_deg for each in find_port_openings(image, rim.inner)) if rim else ()
