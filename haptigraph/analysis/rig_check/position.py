"""Check where the eye is in the picture: wholly visible, and where it was registered."""

import math
from collections.abc import Iterator

import numpy as np

from haptigraph.analysis.rig_check.motion import Motion, by_reference, by_rim, turned_ports
from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.rim import TYPICAL_WALL_MIDDLE
from haptigraph.rig.description import Rig

__all__ = ["moved", "residuals", "whole_eye"]

MAX_NEARER, MAX_FARTHER = 1.05, 0.95
"""Apparent size of the eye against the registered one. A rim before the section appears up to 3 % larger."""
MAX_MOVED_MM, MAX_MOVED_PX = 0.15, 1.5
"""Largest motion of globe and trocars; the larger holds. Contacts are judged at 0.7 mm."""
SCALE_RANGE = 0.985, 1.035  # of the rim against the registered circle
REFERENCE_SCALE_RANGE = 0.99, 1.01  # of the rim against that of the reference image
MAX_RESIDUAL_MM, MAX_RESIDUAL_PX = 0.15, 1.0
MAX_PORT_MM = 0.1
"""Along the wall, besides two standard deviations of a port opening: 0.5 mm, or 1.3 mm behind a shaft."""
MIN_SUPPORT = 0.6
MAX_LAYER_MM = 0.3  # of a registered retina before the wall: a thicker one is not at the rim


def whole_eye(view: View, rig: Rig | None) -> Subject:
    """Judge whether the eye is wholly visible, and the camera neither nearer nor farther than registered."""
    if view.rim is None:
        return Subject("eye in view", findings=(Finding("eye_not_found", view.problem),))
    inner, outer = view.rim.inner, view.rim.outer
    radius_px = outer.radius_px if outer else inner.radius_px * (2 * TYPICAL_WALL_MIDDLE - 1)
    (x, y), (height, width) = inner.center_px, view.image.shape[:2]
    beyond_px = max(radius_px - x, x + radius_px - width + 1, radius_px - y, y + radius_px - height + 1)
    size = inner.radius_px / view.radius_px
    measured = {"margin_mm": -beyond_px / view.px_per_mm, "size_share": size}
    return Subject("eye in view", measured, tuple(_view_findings(view, rig, beyond_px, size)))


def _view_findings(view: View, rig: Rig | None, beyond_px: float, size: float) -> Iterator[Finding]:
    if beyond_px > 0:
        yield Finding(
            "camera_near",
            f"the eye extends {beyond_px:.0f} px beyond the picture; all of its wall must be visible: move "
            "the camera away, or centre the eye",
        )
    elif size > MAX_NEARER:
        yield Finding(
            "camera_near",
            f"the eye appears {size - 1:.0%} larger than registered; at most {MAX_NEARER - 1:.0%} is valid: "
            "move the camera back to where it was, or register again",
        )
    elif size < MAX_FARTHER:
        yield Finding(
            "camera_far",
            f"the eye appears {1 - size:.0%} smaller than registered; at most {1 - MAX_FARTHER:.0%} is "
            "valid: move the camera back to where it was, or register again",
        )
    if rig is not None and rig.camera.width_px == view.registration.width_px:
        front_mm = _distance_mm(view, rig) - rig.camera.pupil_mm
        if front_mm < rig.camera.nearest_mm * (1 - 3 * rig.tolerances.focal_percent / 100):
            yield Finding(
                "camera_near",
                f"by the size of the eye the camera is {front_mm:.0f} mm away; at least "
                f"{rig.camera.nearest_mm:g} mm is valid for a {rig.camera.model}: move it away",
            )


def _distance_mm(view: View, rig: Rig) -> float:
    """Return the distance of the entrance pupil from the cut face, along the path."""
    return rig.camera.focal_px * rig.eye.diameter_mm / 2 / view.found_radius_px


def moved(view: View) -> Subject:
    """Judge whether the eye has moved in the picture since it was registered."""
    best = by_reference(view) or by_rim(view)
    if best is None:
        return Subject("position", not_judged="no rim of an eye was found")
    scale_range = REFERENCE_SCALE_RANGE if view.reference_rim else SCALE_RANGE
    measured = {"shift_mm": best.shift_px / view.px_per_mm, "shift_sd_mm": best.shift_sd_px / view.px_per_mm}
    measured |= {"scale_share": best.scale, "scale_sd_share": best.scale_sd}
    if best.turn_deg is not None:
        measured |= {"turn_deg": best.turn_deg, "turn_sd_deg": best.turn_sd_deg}
    findings = tuple(_moved_findings(view, best, scale_range))
    not_judged = ""
    if best.shift_sd_px > max(MAX_MOVED_MM * view.px_per_mm, MAX_MOVED_PX):
        not_judged = f"its shift, which is uncertain by {best.shift_sd_px / view.px_per_mm:.2f} mm"
    elif best.turn_deg is None:
        not_judged = (
            "its rotation: there is no reference image that resembles the picture, and the port openings are "
            "not visible where they were registered"
        )
    return Subject("position", measured, findings, not_judged)


def _moved_findings(view: View, motion: Motion, scale_range: tuple[float, float]) -> Iterator[Finding]:
    limit_px = max(MAX_MOVED_MM * view.px_per_mm, MAX_MOVED_PX)
    mm, remedy = 1 / view.px_per_mm, "put it back, or register again"
    if motion.shift_px > limit_px + 2 * motion.shift_sd_px:
        yield Finding(
            "moved",
            f"by {motion.evidence}, the eye has moved {motion.shift_px * mm:.2f} mm in the picture "
            f"(standard deviation {motion.shift_sd_px * mm:.2f} mm) since it was registered; at most "
            f"{limit_px * mm:.2f} mm is valid: {remedy}",
        )
    limit_deg = math.degrees(limit_px / view.radius_px)
    if motion.turn_deg is not None and abs(motion.turn_deg) > limit_deg + 2 * motion.turn_sd_deg:
        yield Finding(
            "moved",
            f"by {motion.evidence}, the eye is turned by {motion.turn_deg:+.1f} deg (standard deviation "
            f"{motion.turn_sd_deg:.2f} deg) since it was registered; at most {limit_deg:.1f} deg is valid: "
            f"{remedy}",
        )
    low, high = scale_range
    margin = 2 * motion.scale_sd
    if not low - margin <= motion.scale <= high + margin:
        yield Finding(
            "moved",
            f"by {motion.evidence}, the eye appears {motion.scale:.3f} times as large (standard "
            f"deviation {motion.scale_sd:.3f}) as registered; {low:g} to {high:g} is valid: {remedy}",
        )


def residuals(view: View) -> Subject:
    """Judge how well the registered globe, retina and trocars fit, apart from a motion of the whole eye."""
    if view.rim is None:
        return Subject("registration", not_judged="no rim of an eye was found")
    inner, mm = view.rim.inner, 1 / view.px_per_mm
    measured = {
        "rim_residual_mm": float(np.hypot(inner.residual_px, inner.out_of_round_px)) * mm,
        "rim_support_share": inner.support_ratio,
    }
    if (retina_mm := _retina_residual_mm(view, inner)) is not None:
        measured["retina_residual_mm"] = retina_mm
    mm_per_deg = math.radians(view.registration.globe.radius_mm)
    if turned := turned_ports(view):
        turn_deg = np.array([port.turn_deg for port in turned])
        measured["port_residual_mm"] = float(np.abs(turn_deg - turn_deg.mean()).max()) * mm_per_deg
        measured["port_residual_sd_mm"] = max(port.sd_deg for port in turned) * mm_per_deg
    limit_mm = max(MAX_RESIDUAL_MM, MAX_RESIDUAL_PX * mm)
    return Subject("registration", measured, tuple(_residual_findings(measured, limit_mm)))


def _residual_findings(measured: dict[str, float], limit_mm: float) -> Iterator[Finding]:
    if (support := measured["rim_support_share"]) < MIN_SUPPORT:
        yield Finding(
            "rim_support",
            f"the rim is visible on {support:.0%} of its circumference; at least {MIN_SUPPORT:.0%} is valid: "
            "remove what covers it, or light it better",
        )
    port_limit_mm = MAX_PORT_MM + 2 * measured.get("port_residual_sd_mm", 0.0)
    if (off_mm := measured.get("port_residual_mm", 0.0)) > port_limit_mm:
        yield Finding(
            "residual",
            f"the port openings are off their trocars by {off_mm:.2f} mm, at most {port_limit_mm:.1f} mm "
            "is valid: register again",
        )
    for what, sentence in (
        ("rim", "the rim is not round: register again, so that the camera's tilt is corrected"),
        ("retina", "the registered retina is not where the globe's edge is: register again"),
    ):
        if (off_mm := measured.get(f"{what}_residual_mm", 0.0)) > limit_mm:
            yield Finding(
                "residual",
                f"the {what} is off by {off_mm:.2f} mm (RMS), at most {limit_mm:.2f} mm is valid; {sentence}",
            )


def _retina_residual_mm(view: View, inner: Edge) -> float | None:
    """Return the RMS distance of the registered retina from the rim, after shift and scale of the rim."""
    image, globe_mm = view.registration.image, view.registration.globe.radius_mm
    points = np.array(view.registration.retina.points_mm)
    radii_mm = np.hypot(points[:, 0], points[:, 1])
    if abs(float(radii_mm.mean()) - globe_mm) > MAX_LAYER_MM:
        return None
    sign = -1.0 if image.mirrored else 1.0
    angles = np.arctan2(sign * points[:, 0], -points[:, 1])
    edge_mm = inner.radii_px(angles) / inner.radius_px * globe_mm
    return float(np.sqrt(np.mean((edge_mm - radii_mm) ** 2)))
