"""How far a registration is from its rig's design [px, mm, standard deviations], and the likely cause."""

import math

import numpy as np
from msgspec import Struct

from haptigraph.analysis.registering.design import Design
from haptigraph.analysis.registering.report import in_px_and_mm
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.registration.text import AnatomyPx
from haptigraph.rig.prediction import Angles, vec_of

__all__ = ["Deviation", "design_lines", "deviations"]

WARN_SD = 3.0
MEASURED_SD_PX = 0.5  # of a registration itself


class Deviation(Struct, frozen=True):
    """How far one quantity is from the design."""

    what: str
    off: str
    """The difference, with its unit."""
    sd: float
    """The difference in standard deviations."""
    cause: str
    """The likely cause, if it is too far."""

    @property
    def is_within(self) -> bool:
        """Whether tolerances explain it."""
        return self.sd <= WARN_SD


def deviations(design: Design, anatomy: Anatomy, found: AnatomyPx) -> tuple[Deviation, ...]:
    """Compare a registration with the design, quantity by quantity."""
    parts = [_center(design, found), _scale(design, found), _tilt(design, anatomy)]
    roll = _roll(design, anatomy)
    return (*parts, roll) if roll else tuple(parts)


def design_lines(
    design: Design, anatomy: Anatomy, angles: Angles, found: AnatomyPx, *, has_target: bool
) -> list[str]:
    """Return the report's lines about the design, with a warning for each quantity beyond 3 sd.

    Args:
        design: The design.
        anatomy: What was found.
        angles: Of ports and target, `estimated` from it.
        found: The registration.
        has_target: Whether its target is the design's.
    """
    compared, mm = deviations(design, anatomy, found), design.prediction.mm_per_px
    off_px = math.dist(found.target_px, vec_of(design.prediction.expected.target_px[0]))
    states = f"{design.file} states scale, mirror" + (", rim and target" if has_target else " and rim")
    lines = [
        f"design     {states}; off it: "
        + ", ".join(f"{each.what} {each.off}, {each.sd:.1f} sd" for each in compared)
    ]
    if has_target:
        target_deg, sd_deg = angles.target_deg
        turned_deg = target_deg - design.prediction.angles.target_deg[0]
        sd_px = math.radians(sd_deg) * anatomy.radius_px
        lines.append(
            f"           target at its designed angle {turned_deg:+.1f} deg as the ports are turned, "
            f"uncertain by {in_px_and_mm(sd_px, mm)}; {in_px_and_mm(off_px, mm)} from its designed position"
        )
    return lines + [
        f"WARNING    {each.what} {each.off} off the design, {each.sd:.1f} standard deviations: {each.cause}"
        for each in compared
        if not each.is_within
    ]


def _center(design: Design, found: AnatomyPx) -> Deviation:
    expected, sd = design.prediction.expected, design.prediction.sd
    off_px = np.array(found.center_px) - expected.center_px[0]
    in_sd = np.abs(off_px) / np.hypot(sd.center_px[0], MEASURED_SD_PX)
    distance_px, camera = float(np.hypot(*off_px)), design.prediction.rig.camera
    turned_deg = math.degrees(math.atan(distance_px / camera.focal_px))
    mirror = f", the mirror by {turned_deg / 2:.1f} deg" if design.prediction.rig.mirrors else ""
    mm = distance_px * design.prediction.mm_per_px
    return Deviation(
        "centre",
        f"{distance_px:.1f} px ({mm:.2f} mm)",
        float(in_sd.max()),
        f"likely the camera is turned by {turned_deg:.1f} deg{mirror}, or one of them or the eye is shifted "
        f"by {mm:.1f} mm: check their seats and screws",
    )


def _scale(design: Design, found: AnatomyPx) -> Deviation:
    expected_px, sd_px = (
        float(each.radius_px[0]) for each in (design.prediction.expected, design.prediction.sd)
    )
    ratio = found.radius_px / expected_px
    nearer_mm = design.prediction.rig.path_mm * (1 - 1 / ratio)
    where = "nearer" if nearer_mm > 0 else "farther away"
    rig = design.prediction.rig
    return Deviation(
        "scale",
        f"{ratio - 1:+.1%}",
        abs(found.radius_px - expected_px) / math.hypot(sd_px, MEASURED_SD_PX),
        f"likely the camera is {abs(nearer_mm):.1f} mm {where} than designed, its lens has another focal "
        f"length than horizontal_fov_deg says, or the eye is {rig.eye.diameter_mm * ratio:.1f} mm wide",
    )


def _tilt(design: Design, anatomy: Anatomy) -> Deviation:
    tilt_deg = np.degrees(anatomy.tilt.tilt_rad) if anatomy.tilt else np.zeros(2)
    in_sd = np.abs(tilt_deg) / design.prediction.sd.tilt_deg[0]
    return Deviation(
        "tilt",
        f"{math.hypot(*tilt_deg):.1f} deg",
        float(in_sd.max()),
        "likely the cut face does not face the camera: check the eye's seat and the mirror's angle",
    )


def _roll(design: Design, anatomy: Anatomy) -> Deviation | None:
    """Compare the ports' angles; None if no port was found."""
    if not anatomy.trocars:
        return None
    expected = design.expected
    offs_deg = [expected.off_port_deg(trocar.angle_deg) for trocar in anatomy.trocars]
    sds_deg = [
        math.hypot(expected.ports_sd_deg, design.measured_sd_deg(trocar)) for trocar in anatomy.trocars
    ]
    off_deg = float(np.median(offs_deg))
    return Deviation(
        "ports",
        f"{off_deg:+.1f} deg",
        abs(float(np.median(np.divide(offs_deg, sds_deg)))),
        "likely the eye or the camera is turned about the line of sight, or the trocars are not in the rig's "
        "ports: check the eye's pin and the camera's screws",
    )
