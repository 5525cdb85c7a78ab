"""Record the golden runs again, from the repository's root: `make golden`. Review the changes before committing.

python tests/replay/make_golden.py [SCENARIO ...]
"""

import sys
from pathlib import Path

from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.sim import scenario as scenario_module
from haptigraph.sim.oct import phantom as ioct
from haptigraph.sim.scenario import load_scenario
from haptigraph.toml_document import Document

GOLDEN = Path("tests/replay/golden")  # relative: recordings keep the path they were given
SETTINGS = ("run.realtime=false",)
OPTIONS = {
    "bent_needle": ("subretinal_injection_robot", 85),
    "membrane_peeling": ("membrane_peeling", 75),
    "injection_with_phases": ("subretinal_injection_phases", 85),
    "ioct_approach": ("subretinal_injection_ioct", 50),
    "laser_photocoagulation": ("laser_photocoagulation", 85),
    "vein_cannulation": ("vein_cannulation", 85),
}
"""Procedure and JPEG quality by scenario, where they differ from the defaults."""


def small(name: str, target_mm: float | None = None) -> scenario_module.Scenario:
    """A shipped scenario with small images, five a second."""
    scenario = load_scenario(name, target_mm)
    if scenario.forceps:  # jaws are thin: magnify
        size, center_px, px_per_mm, rate_hz = (260, 260), (130.0, 135.0), 8.8, 4.0
    else:
        size, center_px, px_per_mm, rate_hz = (320, 180), (160.0, 98.0), 5.6, 5.0
    camera = replace(
        scenario.camera,
        width_px=size[0],
        height_px=size[1],
        center_px=center_px,
        px_per_mm=px_per_mm,
        blur_px=0.5,
    )
    return replace(scenario, camera=camera, about=replace(scenario.about, rate_hz=rate_hz))


def small_scans(document: Document, load=ioct.load_scan_scenario) -> ioct.ScanScenario:
    """A shipped B-scan scenario with small images, two a second."""
    scenario = load(document)
    scan = replace(
        scenario.scan, width_px=288, height_px=288, axial_mm_per_px=0.0059, lateral_mm_per_px=0.0139
    )
    needle = replace(scenario.needle, width_px=4.0, bevel_px=9.0)
    return replace(scenario, scan=scan, needle=needle, about=replace(scenario.about, rate_hz=2.0))


def main() -> None:
    GOLDEN.mkdir(exist_ok=True)
    ioct.load_scenario, ioct.load_scan_scenario = small, small_scans
    for name in sys.argv[1:] or [path.stem for path in sorted(GOLDEN.glob("*.mcap"))]:
        path = GOLDEN / f"{name}.mcap"
        path.unlink(missing_ok=True)
        procedure, quality = OPTIONS.get(name, ("subretinal_injection", 85))
        overrides = (
            f"source.jpeg_quality={quality}",
            f"source.uri=phantom:{name}",
            f"run.procedure={procedure}",
            f'recording.path="{path}"',
        )
        report = assemble.build(load_config(None, (*SETTINGS, *overrides))).run()
        print(f"{path.name}: {report.steps} steps, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
