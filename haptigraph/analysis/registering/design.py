"""What the design of a rig adds to a registration: where to search, scale, mirror, target, trocar in use.

Angles are from the top, positive to the image's right; the eye appears turned by `roll_deg`, clockwise.
"""

import math

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.registering.overrides import Overrides, named_trocars
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.perception.anatomy.port_opening import MIN_SEPARATION_DEG
from haptigraph.rig.description import load_rig
from haptigraph.rig.prediction import Prediction, predict, vec_of

__all__ = ["Design", "load_design"]

PORT_SD_MM = 0.3  # of a port found in the image, along the wall


class Design(Struct, frozen=True, eq=False):
    """A rig's design as a prior of its registration."""

    file: str
    prediction: Prediction

    @property
    def expected(self) -> Expected:
        """Where the anatomy should be in the image."""
        expected, sd, eye = self.prediction.expected, self.prediction.sd, self.prediction.rig.eye
        sign = -1 if self.prediction.rig.mirrored else 1
        print_sd_deg = self._along_deg(self.prediction.rig.tolerances.print_mm)
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
            ports_deg=tuple(sign * each for each in eye.trocars_deg),
            ports_sd_deg=math.hypot(float(sd.roll_deg[0]), print_sd_deg),
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

    def completed(self, anatomy: Anatomy) -> Anatomy:
        """Return the anatomy with the ports that no picture shows, turned with the eye."""
        roll_deg, _ = self.roll(anatomy)
        ratio = 1 + self.prediction.rig.eye.wall_mm / self.prediction.rig.eye.diameter_mm
        unseen = tuple(
            FoundTrocar(_point_at(anatomy, ratio, angle_deg), angle_deg, None, is_designed=True)
            for angle_deg in (port_deg + roll_deg for port_deg in self.expected.ports_deg)
            if all(abs(found.angle_deg - angle_deg) > MIN_SEPARATION_DEG for found in anatomy.trocars)
        )
        return replace(anatomy, trocars=(*anatomy.trocars, *unseen))

    def placed(self, overrides: Overrides, anatomy: Anatomy) -> Overrides:
        """Return the overrides with target and trocar in use, unless the user or a needle says otherwise.

        Args:
            overrides: What the user stated.
            anatomy: What was found, `completed`.
        """
        eye, mirrored = self.prediction.rig.eye, self.prediction.rig.mirrored
        roll_deg, _ = self.roll(anatomy)
        if overrides.target is None and overrides.target_mm is None:
            target_deg = eye.target_deg + (roll_deg if mirrored else -roll_deg)
            overrides = replace(overrides, target_mm=math.radians(target_deg) * eye.diameter_mm / 2)
        if overrides.trocar is not None or any(trocar.rcm for trocar in anatomy.trocars):
            return overrides
        used_deg = self.expected.ports_deg[0] + roll_deg
        named = named_trocars(anatomy, mirrored)
        name, _ = min(named, key=lambda each: abs(each[1].angle_deg - used_deg))
        return replace(overrides, trocar=name)

    def roll(self, anatomy: Anatomy) -> tuple[float, float]:
        """Return how far the eye appears turned [deg] and its standard deviation: by tolerances and ports."""
        expected, prior_sd, port_sd = self.expected, float(self.prediction.sd.roll_deg[0]), self.port_sd_deg
        offs = [
            expected.off_port_deg(trocar.angle_deg)
            for trocar in anatomy.trocars
            if expected.is_port(trocar.angle_deg) and not trocar.is_designed
        ]
        weight = 1 / prior_sd**2 + len(offs) / port_sd**2
        return sum(offs) / port_sd**2 / weight, math.sqrt(1 / weight)

    @property
    def port_sd_deg(self) -> float:
        """Standard deviation of a port's angle as found, against the eye: printed, and seen in the image."""
        return self._along_deg(math.hypot(self.prediction.rig.tolerances.print_mm, PORT_SD_MM))

    def _along_deg(self, along_mm: float) -> float:
        """Return the angle at the globe's centre of a length along its wall."""
        return math.degrees(along_mm / (self.prediction.rig.eye.diameter_mm / 2))


def load_design(file: str) -> Design:
    """Read rig.toml, and predict its registration.

    Raises:
        BadInput: If it is not valid.
    """
    return Design(file, predict(load_rig(file)))


def _point_at(anatomy: Anatomy, ratio: float, angle_deg: float) -> Vec:
    """Return a point in the frontal view, at a distance from the globe's centre relative to its radius."""
    angle, (x, y) = math.radians(angle_deg), anatomy.center_px
    distance_px = ratio * anatomy.radius_px
    return x + distance_px * math.sin(angle), y - distance_px * math.cos(angle)
