"""The text of `rig predict`: the predicted registration, its standard deviations, and the optics."""

import math
from collections.abc import Sequence

from haptigraph.rig.description import Rig
from haptigraph.rig.optics import OpticalCheck, optics_of
from haptigraph.rig.prediction import DRAWS, Prediction, predicted_anatomy

__all__ = ["prediction_lines"]

TOPS = {"up": "away from the eye", "down": "towards the eye", "left": "up", "right": "up"}


def prediction_lines(prediction: Prediction, checks: Sequence[OpticalCheck]) -> list[str]:
    """Return the report, line by line."""
    rig, optics = prediction.rig, optics_of(prediction.rig)
    behind = f"{optics.sharp_to_mm:.1f} mm behind it" if math.isfinite(optics.sharp_to_mm) else "infinity"
    before = f"{abs(optics.sharp_from_mm):.1f} mm {'before' if optics.sharp_from_mm >= 0 else 'behind'} it"
    return [
        f"{rig.name}: {rig.camera.model}, {rig.camera.width_px} x {rig.camera.height_px} px",
        *_registration_lines(prediction),
        f"mounting   {_mounting(rig)}",
        f"scale      {optics.px_per_mm:.2f} px/mm: touching, 0.7 mm, is {optics.touching_px:.1f} px; "
        f"aligned, 1.7 deg, moves the end of 10 mm of shaft by {optics.aligned_px:.1f} px",
        f"sharpness  defocus of at most 1 px from {before} to {behind}; Airy's disc {optics.airy_px:.1f} px",
        *(_check_line(check) for check in checks),
    ]


def _registration_lines(prediction: Prediction) -> list[str]:
    anatomy, sd = predicted_anatomy(prediction.rig, prediction.expected), prediction.sd
    (x, y), (x_sd, y_sd) = anatomy.center_px, sd.center_px[0]
    target, (target_x_sd, target_y_sd) = anatomy.target_px, sd.target_px[0]
    lines = [
        f"standard deviations over {DRAWS} rigs drawn from the tolerances",
        f"globe      centre ({x:.1f} +- {x_sd:.1f}, {y:.1f} +- {y_sd:.1f}) px, radius "
        f"{anatomy.radius_px:.1f} +- {sd.radius_px[0]:.1f} px; turned by 0 +- {sd.roll_deg[0]:.1f} deg, "
        f"tilted by 0 +- {sd.tilt_deg.max():.1f} deg",
        f"target     ({target[0]:.1f} +- {target_x_sd:.1f}, {target[1]:.1f} +- {target_y_sd:.1f}) px",
    ]
    for trocar, (x_sd, y_sd) in zip(anatomy.trocars, sd.ports_px[0], strict=True):
        x, y = trocar.point_px
        used = ", in use" if trocar.used else ""
        lines.append(f"trocar     {trocar.name}{used}: ({x:.1f} +- {x_sd:.1f}, {y:.1f} +- {y_sd:.1f}) px")
    return lines


def _mounting(rig: Rig) -> str:
    if not rig.mirrors:
        return "the camera faces the eye, its top up; its images are not mirrored"
    (mirror,) = rig.mirrors
    place = {"up": "above", "down": "below"}.get(mirror.turns, f"on the {mirror.turns} of")
    return f"the camera is {place} the mirror, its top {TOPS[mirror.turns]}; its images are mirrored"


def _check_line(check: OpticalCheck) -> str:
    limit = f"{'at least' if check.is_at_least else 'at most'} {check.limit:g} {check.unit}"
    verdict = "ok" if check.is_met else f"FAILS: {check.advice}"
    return f"check      {check.name}: {check.value:.1f} {check.unit}, {limit}: {verdict}"
