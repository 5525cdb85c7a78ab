"""How often states flicker at thresholds, with and without release and hold, and whether alarms come later.

First the noise of the tracker is measured anew, on a needle that is held still in simulated images; then a
needle rests for a minute on each threshold, and is pushed into the retina off the target 200 times.
`--figure FILE` draws it instead.
"""

import sys
from itertools import pairwise

from matplotlib.figure import Figure

from haptigraph.analysis.angle_noise import angle_noise
from haptigraph.analysis.chatter import NOISE, alarm_delays, approaches, conclude, observe, resting_places
from haptigraph.analysis.colors import state_color
from haptigraph.assemble import load_procedure
from haptigraph.config import load_config
from haptigraph.geometry import Geometry, ImageGeometry
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Observation
from haptigraph.perception.registration import parse_registration
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sim.eye import Eye, EyeShape, registration_text

IMAGES = 1800  # a minute
APPROACHES = 200
SHOWN = {"retina 0.7 mm": ("distance_to_retina_mm", 0.7, 0.8), "theta 1.7 deg": ("theta_deg", 1.7, 1.5)}
SHOWN_IMAGES = 150


def anatomy() -> dict[str, Geometry]:
    """Return what is registered of the simulated eye."""
    image = ImageGeometry(center_px=(640.0, 402.0), mm_per_px=1 / 20, mirrored=True)
    return parse_registration(registration_text(Eye(EyeShape()), image, 1280, 720), "the eye").anatomy


def changes(states: list[str]) -> int:
    """Count changes of state."""
    return sum(one != other for one, other in pairwise(states))


def measured_noise() -> None:
    """Print the tracker's noise beside what is simulated here."""
    held = angle_noise(["tracker"], load_config(None, ("perception.alpha=1",)))
    for title, told, unit, simulated in (
        ("tip", [one.tip_noise_mm["tracker"] for one in held], "mm", NOISE.tip_mm),
        ("angle", [one.noise_deg["tracker"] for one in held], "deg", NOISE.theta_deg),
    ):
        most = max(value for value in told if value is not None)
        print(f"deviation of the {title:6} at most {most:.4f} {unit} at any depth; simulated: {simulated:g}")


def draw(plain: Procedure, steady: Procedure, path: str) -> None:
    """Draw five seconds of a needle at rest on two of the thresholds."""
    eye = anatomy()
    places = resting_places(eye, plain)
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    columns = figure.subplots(3, len(SHOWN), sharex=True, height_ratios=(3, 0.55, 0.55))
    for number, (name, (measure, bound, release)) in enumerate(SHOWN.items()):
        told, *strips = columns[:, number]
        seen = list(observe(eye, [places[name]] * SHOWN_IMAGES, NOISE, seed=1))
        seconds = [one.stamp_ns / 1e9 for one in seen]
        told.plot(seconds, _measured(plain, seen, measure), ".-", color="#444", linewidth=0.6, markersize=3)
        told.axhline(bound, color="#d03a3a", linewidth=1.2, label=f"threshold {bound:g}")
        told.axhline(release, color="#d03a3a", linewidth=1.2, linestyle="--", label=f"release {release:g}")
        told.set_title(f"{measure}, needle at rest", fontsize=10)
        beside = (1.0, release + 0.25 * (bound - release))  # where the noise does not reach
        told.legend(
            fontsize=8, loc="center right", bbox_to_anchor=beside, bbox_transform=told.get_yaxis_transform()
        )
        for strip, procedure, title in zip(
            strips, (plain, steady), ("as in the paper", "steadied"), strict=True
        ):
            states = conclude(procedure, seen)
            for at, state in zip(seconds, states, strict=True):
                strip.axvspan(at, at + 1 / 30, color=state_color(state), linewidth=0)
            strip.set_yticks([])
            strip.set_title(f"{title}, changes of state: {changes(states)}", fontsize=9, loc="left")
        strips[-1].set_xlabel("time [s]")
        strips[-1].set_xlim(0, SHOWN_IMAGES / 30)
    figure.savefig(path, dpi=110)


def _measured(procedure: Procedure, seen: list[Observation], measure: str) -> list[float]:
    build_scene = SchemaSceneBuilder(procedure.schema)
    return [build_scene(observation).measures[measure] for observation in seen]


def main() -> None:
    """Measure and print, and draw where that is asked."""
    plain, steady = load_procedure("subretinal_injection"), load_procedure("subretinal_injection_steady")
    if "--figure" in sys.argv:
        draw(plain, steady, sys.argv[sys.argv.index("--figure") + 1])
        return
    measured_noise()
    eye = anatomy()
    print(f"\n{'changes of state in a minute at':34}{'as in the paper':>16}{'steadied':>10}")
    sums = [0, 0]
    for name, place in resting_places(eye, plain).items():
        seen = list(observe(eye, [place] * IMAGES, NOISE, seed=1))
        counts = [changes(conclude(procedure, seen)) for procedure in (plain, steady)]
        sums = [before + count for before, count in zip(sums, counts, strict=True)]
        print(f"  {name:32}{counts[0]:16}{counts[1]:10}")
    print(f"  {'all':32}{sums[0]:16}{sums[1]:10}")
    delays = [
        alarm_delays(plain, steady, list(observe(eye, needles, NOISE, seed)))
        for seed, needles in enumerate(approaches(APPROACHES, seed=0))
    ]
    print(f"{APPROACHES} contacts: the alarm comes {min(delays)} to {max(delays)} images later when steadied")


if __name__ == "__main__":
    main()
