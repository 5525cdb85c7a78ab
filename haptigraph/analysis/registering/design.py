"""What the design of a rig adds to a registration: where to search, scale, mirror, target, trocar in use.

Angles are from the top, positive to the image's right. Those of ports and target are estimated jointly, as a
normal distribution: a port that is found says how far the eye is turned, and so where the target is.
"""

import math
from itertools import compress

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.registering.overrides import Overrides, named_trocars
from haptigraph.errors import BadInput
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar, point_at
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.perception.anatomy.port_opening import MIN_SEPARATION_DEG
from haptigraph.rig.description import load_rig
from haptigraph.rig.prediction import Angles, Prediction, predict, vec_of

__all__ = ["Design", "load_design"]

RCM_SD_MM = 0.3  # along the wall: an instrument need not move in the middle of its port


class Design(Struct, frozen=True, eq=False):
    """A rig's design as a prior of its registration."""

    file: str
    prediction: Prediction

    @property
    def expected(self) -> Expected:
        """Where the anatomy should be in the image."""
        expected, sd, angles = self.prediction.expected, self.prediction.sd, self.prediction.angles
        return Expected(
            center_px=vec_of(expected.center_px[0]),
            center_sd_px=vec_of(sd.center_px[0]),
            radius_px=float(expected.radius_px[0]),
            radius_sd_px=float(sd.radius_px[0]),
            rim_ratio=float(expected.rim_ratio[0]),
            rim_ratio_sd=float(sd.rim_ratio[0]),
            wall_ratio=float(expected.wall_ratio[0]),
            wall_ratio_sd=float(sd.wall_ratio[0]),
            closeness=float(expected.closeness[0]),
            closeness_sd=float(sd.closeness[0]),
            tilt_sd_deg=float(sd.tilt_deg.max()),
            ports_deg=tuple(angle_deg for angle_deg, _ in angles.ports_deg),
            ports_sd_deg=max(sd_deg for _, sd_deg in angles.ports_deg),
        )

    def check_images(self, image: Image, overrides: Overrides, source: str) -> None:
        """Refuse images that the design does not describe.

        Raises:
            BadInput: If they have another size, or are turned.
        """
        camera, (height_px, width_px) = self.prediction.rig.camera, image.shape[:2]
        if (width_px, height_px) != (camera.width_px, camera.height_px):
            raise BadInput(
                f"its images are {width_px} x {height_px} px, but the rig's camera takes "
                f"{camera.width_px} x {camera.height_px} px ({self.file})",
                source,
            )
        if overrides.turn.mirror or overrides.turn.rotate_deg % 180:
            raise BadInput(
                f"{overrides.turn} does not go with --rig, which describes the images as the camera takes "
                "them; only source.rotate_deg=180 is valid, for a camera that is mounted upside down"
            )

    def stated(self, overrides: Overrides) -> Overrides:
        """Return the user's overrides with what the design states: scale and mirror.

        Raises:
            BadInput: If the user states them otherwise.
        """
        rig = self.prediction.rig
        if overrides.diameter_mm not in (None, rig.eye.diameter_mm):
            raise BadInput(
                f"--diameter-mm {overrides.diameter_mm:g} contradicts the rig, whose eye has "
                f"{rig.eye.diameter_mm:g} mm; change eye.diameter_mm in {self.file}, or leave it out"
            )
        if overrides.mirrored not in (None, rig.mirrored):
            seen = "mirrored" if rig.mirrored else "not mirrored"
            raise BadInput(f"the rig's images are {seen} ({self.file}); leave --[not-]mirrored out")
        return replace(overrides, diameter_mm=rig.eye.diameter_mm, mirrored=rig.mirrored)

    def estimated(self, anatomy: Anatomy) -> Angles:
        """Estimate the angles of ports and target jointly, from the design and the ports found."""
        expected = self.expected
        return self.prediction.angles.given(
            (expected.port_number(trocar.angle_deg), trocar.angle_deg, self.measured_sd_deg(trocar))
            for trocar in anatomy.trocars
            if expected.is_port(trocar.angle_deg)
        )

    def completed(self, anatomy: Anatomy, angles: Angles) -> Anatomy:
        """Return the anatomy with all ports at their estimated angles; where a needle moves, its RCM stays.

        Args:
            anatomy: What was found.
            angles: What was `estimated` from it.
        """
        expected, eye = self.expected, self.prediction.rig.eye
        is_port = [expected.is_port(trocar.angle_deg) and not trocar.rcm for trocar in anatomy.trocars]
        kept = tuple(trocar for trocar, port in zip(anatomy.trocars, is_port, strict=True) if not port)
        found = {expected.port_number(each.angle_deg) for each in compress(anatomy.trocars, is_port)}
        distance_px = (1 + eye.wall_mm / eye.diameter_mm) * anatomy.radius_px
        ports = tuple(
            FoundTrocar(
                point_at(anatomy.center_px, distance_px, angle_deg),
                angle_deg,
                None,
                sd_deg,
                number not in found,
            )
            for number, (angle_deg, sd_deg) in enumerate(angles.ports_deg)
            if all(abs(trocar.angle_deg - angle_deg) > MIN_SEPARATION_DEG for trocar in kept)
        )
        return replace(anatomy, trocars=(*kept, *ports))

    def placed(self, overrides: Overrides, anatomy: Anatomy, angles: Angles) -> Overrides:
        """Return the overrides with target and trocar in use, unless the user or a needle says otherwise.

        Args:
            overrides: What the user stated.
            anatomy: What was found, `completed`.
            angles: What was `estimated`.
        """
        eye, mirrored = self.prediction.rig.eye, self.prediction.rig.mirrored
        if overrides.target is None and overrides.target_mm is None:
            target_deg, _ = angles.target_deg
            along_rad = math.radians(target_deg if mirrored else -target_deg)
            overrides = replace(overrides, target_mm=along_rad * eye.diameter_mm / 2)
        if overrides.trocar is not None or any(trocar.rcm for trocar in anatomy.trocars):
            return overrides
        named, (used_deg, _) = named_trocars(anatomy, mirrored), angles.ports_deg[0]
        name, _ = min(named, key=lambda each: abs(each[1].angle_deg - used_deg))
        return replace(overrides, trocar=name)

    def measured_sd_deg(self, trocar: FoundTrocar) -> float:
        """Standard deviation of a port's angle as found in the image."""
        if trocar.angle_sd_deg is not None:
            return trocar.angle_sd_deg
        return math.degrees(RCM_SD_MM / (self.prediction.rig.eye.diameter_mm / 2))


def load_design(file: str) -> Design:
    """Read rig.toml, and predict its registration.

    Raises:
        BadInput: If it is not valid.
    """
    return Design(file, predict(load_rig(file)))
