"""State changes at thresholds with and without release and hold, and the resulting delay of alarms.

Measures the tracker's noise on a static needle in simulated images. Then a needle rests for a minute at each
threshold, and is pushed into the retina beside the target 200 times. `--figure FILE` draws a figure instead.
"""

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from haptigraph.analysis.evaluation.angle_noise import angle_noise
from haptigraph.assemble import load_procedure
from haptigraph.config import load_config
from haptigraph.geometry import Geometry, Point, Segment, Vec, rotate, subtract, unit
from haptigraph.graph import SceneGraph
from haptigraph.inference.colors import PAPER_PALETTE
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Observation
from haptigraph.projection import ImageGeometry
from haptigraph.registration.loading import parse_registration
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

RATE_HZ = 30.0
CONTACT = "retinal_contact"


class Noise(NamedTuple):
    """Standard deviation of perception, per image."""

    tip_mm: float
    """Of the tip, in each of two directions."""
    theta_deg: float
    """Of the shaft's direction."""


NOISE = Noise(tip_mm=0.0065, theta_deg=0.04)
"""The maximum of the tracker at any depth, as measured by this benchmark."""


class Needle(NamedTuple):
    """The pose of a needle."""

    depth_mm: float
    """From the trocar to the tip."""
    theta_deg: float
    """To the line trocar -> target, counter-clockwise."""


def observe(
    anatomy: dict[str, Geometry], needles: Iterable[Needle], noise: Noise, seed: int
) -> Iterator[Observation]:
    """Yield noisy observations of a needle at 30 images per second.

    Args:
        anatomy: The registered anatomy.
        needles: The pose of the needle in each image.
        noise: Added to the pose.
        seed: Of the noise.
    """
    rng = np.random.default_rng(seed)
    for number, needle in enumerate(needles):
        x, y = _tip_mm(anatomy, needle)
        error_x, error_y, turn = rng.standard_normal(3) * (noise.tip_mm, noise.tip_mm, noise.theta_deg)
        tip_mm = float(x + error_x), float(y + error_y)
        along = rotate(_axis(anatomy), needle.theta_deg + float(turn))
        entry_mm = tip_mm[0] - 10.0 * along[0], tip_mm[1] - 10.0 * along[1]
        found = {**anatomy, "needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)}
        yield Observation(round(number * 1e9 / RATE_HZ), found)


def conclude(procedure: Procedure, observations: Iterable[Observation]) -> list[str]:
    """Return the state of every image."""
    build_scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(procedure)
    return [reason(build_scene(observation)).state for observation in observations]


def resting_needles(anatomy: dict[str, Geometry], procedure: Procedure) -> dict[str, Needle]:
    """Return a needle at each threshold of the paper's procedure, by the name of the threshold."""
    side = 4.0  # degrees: clearly beside the target, but over the retina

    def needle_at(measure: str, value: float, theta_deg: float, low_mm: float, high_mm: float) -> Needle:
        """Find by bisection the depth between two depths at which a measure has a value."""
        build_scene = SchemaSceneBuilder(procedure.schema)

        def measured(depth_mm: float) -> SceneGraph:
            build_scene.reset()
            return build_scene(next(observe(anatomy, [Needle(depth_mm, theta_deg)], Noise(0.0, 0.0), seed=0)))

        rises = measured(high_mm).measures[measure] > measured(low_mm).measures[measure]
        for _ in range(50):
            middle_mm = (low_mm + high_mm) / 2
            below = measured(middle_mm).measures[measure] < value
            low_mm, high_mm = (middle_mm, high_mm) if below == rises else (low_mm, middle_mm)
        return Needle(low_mm, theta_deg)

    grazing_deg = math.degrees(math.asin(0.7 / 22.0))
    touching = needle_at("distance_to_retina_mm", 0.3, grazing_deg, 15.0, 25.0)
    return {
        "wall 0 mm": needle_at("wall_mm", 0.0, side, 0.0, 3.0),
        "theta 1.7 deg": Needle(10.0, 1.7),
        "retina 5.5 mm": needle_at("distance_to_retina_mm", 5.5, side, 10.0, 20.0),
        "retina 0.7 mm": needle_at("distance_to_retina_mm", 0.7, side, 15.0, 22.0),
        "axis 0.7 mm": Needle(touching.depth_mm, math.degrees(math.asin(0.7 / touching.depth_mm))),
    }


def approaches(count: int, seed: int) -> Iterator[list[Needle]]:
    """Yield needles that are pushed from 12 mm to beyond the retina, beside the target, at 1 to 20 mm/s."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        theta_deg = float(rng.choice((-1.0, 1.0)) * rng.uniform(2.5, 12.0))
        mm_per_image = float(rng.uniform(1.0, 20.0)) / RATE_HZ
        images = math.ceil(15.0 / mm_per_image)
        yield [Needle(12.0 + number * mm_per_image, theta_deg) for number in range(images)]


def alarm_delays(plain: Procedure, steady: Procedure, observations: Sequence[Observation]) -> int:
    """Return by how many images the alarm of one procedure is later than that of another.

    Raises:
        ValueError: If one of them raises no alarm.
    """
    return conclude(steady, observations).index(CONTACT) - conclude(plain, observations).index(CONTACT)


def _axis(anatomy: dict[str, Geometry]) -> Vec:
    trocar, target = anatomy["trocar"], anatomy["retina_target"]
    if not isinstance(trocar, Point) or not isinstance(target, Point):
        raise ValueError("the anatomy has no trocar or no target")
    return unit(subtract(target.at_mm, trocar.at_mm))


def _tip_mm(anatomy: dict[str, Geometry], needle: Needle) -> Vec:
    trocar, along = anatomy["trocar"], rotate(_axis(anatomy), needle.theta_deg)
    if not isinstance(trocar, Point):
        raise ValueError("the anatomy has no trocar")
    return (
        trocar.at_mm[0] + needle.depth_mm * along[0],
        trocar.at_mm[1] + needle.depth_mm * along[1],
    )


IMAGES = 1800  # a minute
APPROACHES = 200
SHOWN = {"retina 0.7 mm": ("distance_to_retina_mm", 0.7, 0.8), "theta 1.7 deg": ("theta_deg", 1.7, 1.5)}
LABELS = {"distance_to_retina_mm": "distance to retina [mm]", "theta_deg": "theta [°]"}
SHOWN_IMAGES = 150


def anatomy() -> dict[str, Geometry]:
    """Return the registered anatomy of the simulated eye."""
    image = ImageGeometry(center_px=(640.0, 402.0), mm_per_px=1 / 20, mirrored=True)
    return parse_registration(registration_text(Eye(EyeShape()), image, 1280, 720), "the eye").anatomy


def changes(states: list[str]) -> int:
    """Count changes of state."""
    return sum(one != other for one, other in pairwise(states))


def measured_noise() -> None:
    """Print the tracker's noise and the simulated noise."""
    static = angle_noise(["tracker"], load_config(None, ("perception.alpha=1",)))
    for title, values, unit_name, simulated in (
        ("tip", [one.tip_noise_mm["tracker"] for one in static], "mm", NOISE.tip_mm),
        ("angle", [one.noise_deg["tracker"] for one in static], "deg", NOISE.theta_deg),
    ):
        maximum = max(value for value in values if value is not None)
        print(f"SD of the {title:6} at most {maximum:.4f} {unit_name} at any depth; simulated {simulated:g}")


def draw(plain: Procedure, steady: Procedure, path: str) -> None:
    """Draw five seconds of a needle at rest at two of the thresholds."""
    eye = anatomy()
    needles = resting_needles(eye, plain)
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    columns = figure.subplots(3, len(SHOWN), sharex=True, height_ratios=(3, 0.55, 0.55))
    for number, (name, (measure, bound, release)) in enumerate(SHOWN.items()):
        top, *bands = columns[:, number]
        observations = list(observe(eye, [needles[name]] * SHOWN_IMAGES, NOISE, seed=1))
        seconds = [one.stamp_ns / 1e9 for one in observations]
        values = _measured(plain, observations, measure)
        top.plot(seconds, values, ".-", color="#444", linewidth=0.6, markersize=3)
        top.axhline(bound, color="#d03a3a", linewidth=1.2, label=f"threshold {bound:g}")
        top.axhline(release, color="#d03a3a", linewidth=1.2, linestyle="--", label=f"release {release:g}")
        top.set_title(f"needle at rest, at the threshold {bound:g}", fontsize=10)
        top.set_ylabel(LABELS[measure])
        anchor = (1.0, release + 0.25 * (bound - release))  # beyond the noise
        top.legend(
            fontsize=8, loc="center right", bbox_to_anchor=anchor, bbox_transform=top.get_yaxis_transform()
        )
        for band, procedure, title in zip(
            bands, (plain, steady), ("as in the paper", "with hysteresis"), strict=True
        ):
            states = conclude(procedure, observations)
            for at, state in zip(seconds, states, strict=True):
                band.axvspan(at, at + 1 / 30, color=PAPER_PALETTE[state].color, linewidth=0)
            band.set_yticks([])
            if number == 0:
                band.set_ylabel("state")
            band.set_title(f"{title}, state changes: {changes(states)}", fontsize=9, loc="left")
        bands[-1].set_xlabel("time [s]")
        bands[-1].set_xlim(0, SHOWN_IMAGES / 30)
    figure.savefig(path, dpi=110)


def _measured(procedure: Procedure, observations: list[Observation], measure: str) -> list[float]:
    build_scene = SchemaSceneBuilder(procedure.schema)
    return [build_scene(observation).measures[measure] for observation in observations]


def main() -> None:
    """Measure and print, or draw."""
    plain, steady = load_procedure("subretinal_injection"), load_procedure("subretinal_injection_steady")
    if "--figure" in sys.argv:
        draw(plain, steady, sys.argv[sys.argv.index("--figure") + 1])
        return
    measured_noise()
    eye = anatomy()
    print(f"\n{'state changes in a minute at':34}{'as in the paper':>16}{'with hysteresis':>17}")
    sums = [0, 0]
    for name, needle in resting_needles(eye, plain).items():
        observations = list(observe(eye, [needle] * IMAGES, NOISE, seed=1))
        counts = [changes(conclude(procedure, observations)) for procedure in (plain, steady)]
        sums = [before + count for before, count in zip(sums, counts, strict=True)]
        print(f"  {name:32}{counts[0]:16}{counts[1]:17}")
    print(f"  {'all':32}{sums[0]:16}{sums[1]:17}")
    delays = [
        alarm_delays(plain, steady, list(observe(eye, needles, NOISE, seed)))
        for seed, needles in enumerate(approaches(APPROACHES, seed=0))
    ]
    delay = f"{min(delays)} to {max(delays)} images"
    print(f"{APPROACHES} contacts: with hysteresis the alarm comes {delay} later")


if __name__ == "__main__":
    main()
