"""Register ray-traced pictures of rigs, and compare with the design: `make rig-registration`.

    PYTHONPATH=. python benchmarks/rig_registration.py build/rig-pictures

Picture 0 of a rig is as designed: every point must lie within 1.5 px of the prediction. The others are drawn
from the tolerances: their differences from the prediction must be distributed as its standard deviations say.
The exit code is 1 if a picture is refused, an exact one is off by more, or a drawn one by more than 4 sd.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from msgspec import Struct

from haptigraph.analysis.registering.overrides import Overrides
from haptigraph.analysis.registering.registering import register_source
from haptigraph.errors import BadInput
from haptigraph.imaging import Floats
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import load_camera_registration
from haptigraph.registration.text import AnatomyPx
from haptigraph.rig.description import Rig, load_rig
from haptigraph.rig.prediction import Observed, Prediction, observe, predict
from rendering.rigs.builds import build_of

RIGS = Path(__file__).parent.parent / "rig"
MAX_EXACT_PX, MAX_SD = 1.5, 4.0


class Compared(Struct):
    """One picture's registration."""

    number: int
    from_truth_px: float
    """Of the worst point, from where the rig as built has it."""
    from_design_px: float
    """Of the worst point, from the prediction."""
    in_sd: list[float]
    """Centre right, down, radius, target right, down: difference from the prediction."""
    warnings: int


def main() -> None:
    """Print a table of all rigs, and a summary."""
    folders = sorted(folder for folder in Path(sys.argv[1]).iterdir() if folder.is_dir())
    print("rig          build  off truth  off design  worst sd  warnings")
    drawn: list[float] = []
    failed = not folders
    for folder in folders:
        file = RIGS / f"{folder.name}.toml"
        prediction = predict(load_rig(file))
        for picture in sorted(folder.glob("[0-9]*.png")):
            try:
                compared = compare(prediction, file, picture)
            except BadInput as error:
                print(f"{folder.name:12} {picture.stem:>5}  refused: {error.problem}")
                failed = True
                continue
            worst = max(map(abs, compared.in_sd))
            print(
                f"{folder.name:12} {compared.number:5}  {compared.from_truth_px:6.2f} px  "
                f"{compared.from_design_px:7.2f} px  {worst:8.2f}  {compared.warnings:8}",
                flush=True,
            )
            if compared.number:
                drawn += compared.in_sd
                failed |= worst > MAX_SD
            else:
                failed |= compared.from_design_px > MAX_EXACT_PX
    if drawn:
        within = (f"{np.mean(np.abs(drawn) <= limit):.0%} within {limit} sd" for limit in (1, 2, 3))
        print(f"{len(drawn)} quantities of drawn rigs: {', '.join(within)}")
    if failed:
        sys.exit(1)


def compare(prediction: Prediction, file: Path, picture: Path) -> Compared:
    """Register one picture, and compare it with the rig as built and with the design."""
    number, rig = int(picture.stem), prediction.rig
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "eye.toml"
        report = register_source(str(picture), output, Overrides(), rig=str(file))
        found = anatomy_px(load_camera_registration(output))
    expected, sd = prediction.expected, prediction.sd
    in_sd = [
        *(np.array(found.center_px) - expected.center_px[0]) / sd.center_px[0],
        (found.radius_px - expected.radius_px[0]) / sd.radius_px[0],
        *(np.array(found.target_px) - expected.target_px[0]) / sd.target_px[0],
    ]
    return Compared(
        number,
        _worst_px(found, observe(rig, build_of(rig, number)), rig),
        _worst_px(found, expected, rig),
        [float(each) for each in in_sd],
        report.count("WARNING"),
    )


def _worst_px(found: AnatomyPx, truth: Observed, rig: Rig) -> float:
    """Return the largest distance of any point of a registration from the truth."""
    sides = {"right": True, "left": False}
    ports = dict(zip((angle > 0 for angle in rig.eye.trocars_deg), truth.ports_px[0], strict=True))
    return max(
        math.dist(found.center_px, truth.center_px[0]),
        abs(found.radius_px - float(truth.radius_px[0])),
        math.dist(found.target_px, truth.target_px[0]),
        _from_line_px(np.array(found.contour_px), truth.retina_px[0]),
        *(math.dist(each.point_px, ports[sides[each.name]]) for each in found.trocars if each.name in sides),
    )


def _from_line_px(points_px: Floats, line_px: Floats) -> float:
    """Return the largest distance of points from a finely sampled line, except beyond its ends."""
    fine = np.stack(
        [np.interp(np.linspace(0, len(line_px) - 1, 4000), range(len(line_px)), axis) for axis in line_px.T],
        1,
    )
    distances = np.hypot(*(points_px[:, None] - fine[None]).transpose(2, 0, 1))
    is_beside = (distances.argmin(axis=1) > 0) & (distances.argmin(axis=1) < len(fine) - 1)
    return float(distances.min(axis=1)[is_beside].max())


if __name__ == "__main__":
    main()
