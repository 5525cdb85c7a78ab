"""Record the golden runs anew, from the repository's root: `make golden`. Read what changed before committing."""

from pathlib import Path

from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.sim import scenario as scenario_module
from haptigraph.sim.scenario import load_scenario, scenario_names
from haptigraph.sources import phantom as phantom_module

GOLDEN = Path("tests/replay/golden")  # relative: recordings keep the path they were given
SETTINGS = ("run.realtime=false", "source.jpeg_quality=85")


def small(name: str) -> scenario_module.Scenario:
    """A shipped scenario in small pictures, five a second."""
    scenario = load_scenario(name)
    camera = replace(
        scenario.camera,
        width_px=320,
        height_px=180,
        center_px=(160.0, 98.0),
        px_per_mm=5.6,
        blur_px=0.5,
    )
    return replace(scenario, camera=camera, about=replace(scenario.about, rate_hz=5.0))


def main() -> None:
    GOLDEN.mkdir(exist_ok=True)
    phantom_module.load_scenario = small
    for name in scenario_names():
        path = GOLDEN / f"{name}.mcap"
        path.unlink(missing_ok=True)
        settings = (*SETTINGS, f"source.uri=phantom:{name}", f'recording.path="{path}"')
        report = assemble.build(load_config(None, settings)).run()
        print(f"{path.name}: {report.steps} steps, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
