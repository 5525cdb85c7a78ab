"""Check the scale against the rig: the eye's diameter, and pixels per millimetre at the camera's distance."""

import math
from collections.abc import Iterator

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.rig.description import Rig

__all__ = ["scale"]

MAX_SD = 3.0
"""Largest deviation of the scale from the rig's, in its standard deviations."""
MAX_DIAMETER_SD = 3.0  # of a printed surface, on either side
RIM_SHARE_SD = 0.01  # of the scale, from the rim's position before the section


def scale(view: View, rig: Rig | None) -> Subject:
    """Judge the registered scale."""
    measured = {"px_per_mm": view.px_per_mm}
    if rig is None:
        return Subject("scale", measured, not_judged="without --rig nothing says how large the eye is")
    sd_mm = MAX_DIAMETER_SD * 2 * rig.tolerances.print_mm
    size_px = view.registration.width_px, view.registration.height_px
    findings = list(_diameter_findings(view, rig, sd_mm))
    factor = size_px[0] / rig.camera.width_px
    if abs(size_px[1] - factor * rig.camera.height_px) > 1:
        reason = (
            f"pixels per mm: images of {size_px[0]} x {size_px[1]} px are a part of the rig's "
            f"{rig.camera.width_px} x {rig.camera.height_px} px"
        )
        return Subject("scale", measured, tuple(findings), reason)
    expected = factor * rig.px_per_mm
    sd_share = math.hypot(
        rig.tolerances.focal_percent / 100,
        math.sqrt(2) * rig.tolerances.position_mm / rig.path_mm,
        RIM_SHARE_SD,
    )
    measured |= {"rig_px_per_mm": expected, "rig_sd_share": sd_share}
    off_share = view.px_per_mm / expected - 1
    if abs(off_share) > MAX_SD * sd_share:
        findings.append(
            Finding(
                "scale",
                f"the registration has {view.px_per_mm:.2f} px/mm, {off_share:+.1%} from the rig's "
                f"{expected:.2f}; at most {MAX_SD * sd_share:.1%} is valid: measure the eye's inner diameter "
                "and the camera's distance, correct rig.toml, or register again with --diameter-mm",
            )
        )
    return Subject("scale", measured, tuple(findings))


def _diameter_findings(view: View, rig: Rig, limit_mm: float) -> Iterator[Finding]:
    registered_mm = 2 * view.registration.globe.radius_mm
    if abs(registered_mm - rig.eye.diameter_mm) > limit_mm:
        yield Finding(
            "scale",
            f"the registration has an eye of {registered_mm:g} mm, the rig one of "
            f"{rig.eye.diameter_mm:g} mm; at most {limit_mm:.1f} mm apart is valid: register again with "
            f"--diameter-mm {rig.eye.diameter_mm:g}",
        )
