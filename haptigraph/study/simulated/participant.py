"""Simulated participants: the traits of an operator, each with unit, distribution and source.

Draws a participant from a seed and a number. No trait is fitted to a result; "assumed" marks those without a
source. "(cited)": the value was read in an abstract or excerpt of the source; "(standard)": a value that is
usually given with this source and was not looked up again.
"""

import math
import warnings
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput, RenamedKey, unknown_name

__all__ = ["OLD_TRAITS", "TRAITS", "Participant", "Trait", "Variation", "draw_participant", "trait_name"]


class Trait(Struct, frozen=True):
    """The distribution of one trait over participants."""

    unit: str
    distribution: Literal["fixed", "normal", "uniform", "lognormal"]
    a: float
    """Value, mean, minimum or median."""
    b: float
    """Unused, standard deviation, maximum or standard deviation of the logarithm."""
    description: str
    source: str

    def draw(self, rng: np.random.Generator) -> float:
        """Draw one participant's value; normal distributions are clipped at two standard deviations."""
        if self.distribution == "normal":
            return self.a + self.b * float(np.clip(rng.standard_normal(), -2, 2))
        if self.distribution == "lognormal":
            return self.a * math.exp(self.b * float(np.clip(rng.standard_normal(), -2, 2)))
        value = rng.uniform(self.a, self.b) if self.distribution == "uniform" else self.a
        return float(value)

    @property
    def spread(self) -> str:
        """Description of the distribution."""
        if self.distribution == "fixed":
            return f"{self.a:g}"
        templates = {
            "normal": "{} ± {}, clipped at 2 SD",
            "uniform": "{} to {}",
            "lognormal": "median {}, SD of log {}",
        }
        return templates[self.distribution].format(f"{self.a:g}", f"{self.b:g}")


TRAITS: dict[str, Trait] = {
    "display_delay_s": Trait(
        "s", "fixed", 0.1, 0,
        "delay from a motion of the tool to its image on the screen",
        "camera 66 ms (RealSense D435, realsense-ros issue 2686, cited) and one image of 33 ms",
    ),
    "visual_delay_s": Trait(
        "s", "uniform", 0.13, 0.2,
        "delay from the image to a corrective hand movement",
        "Saunders and Knill 2005, Exp. Brain Res. 162: 130 to 200 ms for distance (cited)",
    ),
    "actuator_delay_s": Trait(
        "s", "fixed", 0.015, 0,
        "rise time of the actuator",
        "linear resonant actuators 10 to 20 ms (TDK white paper, Mouser; cited)",
    ),
    "reaction_time_s": Trait(
        "s", "normal", 0.213, 0.027,
        "simple reaction time to a haptic stimulus, assumed equal to the visual one",
        "Woods et al. 2015, Front. Hum. Neurosci. 9:131 (standard); equal for touch: 'Accurate "
        "reaction time methods demonstrate similar results', josam.org 2021 (cited)",
    ),
    "dual_task_delay_s": Trait(
        "s", "fixed", 0.13, 0,
        "increase of the reaction time while steering (dual-task cost)",
        "Bao et al. 2019, PLOS ONE 14(8):e0219737: a second task costs more than 130 ms (cited)",
    ),
    "glance_sd_deg": Trait(
        "deg", "uniform", 1.2, 2.4,
        "SD of one visual estimate of the angle between shaft and target",
        "0.6 deg at the cardinal directions ('Recognition of stimulus orientation', Vision Res. 30, 1990; "
        "cited), 2 to 4 times that for oblique lines (Appelle 1972, Psychol. Bull. 78; cited)",
    ),
    "visual_bias_sd_deg": Trait(
        "deg", "uniform", 1.2, 2.4,
        "SD of the bias of that angle, which is constant within a trial",
        "assumed as large as the SD of one estimate; that there are such biases: Bouma and Andriessen 1968, "
        "Vision Res. 8",
    ),
    "distance_sd_share": Trait(
        "1", "uniform", 0.02, 0.06,
        "SD of a visual distance estimate, relative to the distance",
        "difference threshold of lengths, about 4 % (Ono 1967, Percept. Psychophys. 2; standard)",
    ),
    "pace_mm_s": Trait(
        "mm/s", "lognormal", 1.44, 0.23,
        "RMS speed of the tool along its axis",
        "surgeons in eyes: 1.44 mm/s (Zheng et al. 2023, TVST 12(3):32; cited); spread between people as of "
        "completion times in Arbabi et al. 2026, 20.4 s of 87.3 s",
    ),
    "pace_deg_s": Trait(
        "deg/s", "lognormal", 1.74, 0.23,
        "RMS speed of turning the tool",
        "1.74 deg/s (Zheng et al. 2023; cited); spread as above",
    ),
    "throughput_bit_s": Trait(
        "bit/s", "normal", 1.8, 0.4,
        "throughput of Fitts's law, which limits the speed of every movement",
        "joystick 1.8 bit/s (MacKenzie, Kauppinen and Silfverberg 2001, CHI; standard); spread assumed",
    ),
    "plan_s": Trait(
        "s", "fixed", 0.5, 0,
        "time after which the next movement is planned",
        "intermittent control, two corrections a second (Craik 1947, Br. J. Psychol. 38; standard)",
    ),
    "motor_sd_share": Trait(
        "1", "normal", 0.103, 0.02,
        "SD of a movement's amplitude, relative to it",
        "signal-dependent noise 0.103 (van Beers, Haggard and Wolpert 2004, J. Neurophysiol. 91; standard); "
        "spread assumed",
    ),
    "direction_sd_deg": Trait(
        "deg", "normal", 3.5, 0.5,
        "SD of a movement's direction",
        "3 to 4 deg (Gordon, Ghilardi and Ghez 1994, Exp. Brain Res. 99; standard)",
    ),
    "tremor_mm": Trait(
        "mm", "uniform", 0.05, 0.2,
        "hand tremor, RMS per axis, 8 to 12 Hz",
        "50 to 200 µm, 8 to 12 Hz (PMC3989364; cited)",
    ),
    "absolute_threshold": Trait(
        "amplitude", "fixed", 0.05, 0,
        "absolute threshold: lower amplitudes are not perceived",
        "assumed: a third of the weakest pattern of the shipped procedures",
    ),
    "weber_fraction": Trait(
        "1", "fixed", 0.2, 0,
        "Weber fraction of amplitude: SD of a perceived amplitude, relative to it",
        "difference threshold 0.20 at the thenar eminence, 125 Hz ('Vibrotactile difference thresholds', "
        "IEEE Trans. Haptics 2012; cited)",
    ),
    "attention_probability": Trait(
        "1", "uniform", 0.84, 1.0,
        "probability, per planned movement, that haptic cues are attended to",
        "tactile commands during another task: 92 % correct ('Vibrotactile pattern recognition on the arm "
        "and back', Perception 38, 2009; cited); spread assumed",
    ),
    "align_share": Trait(
        "1", "uniform", 0.0, 1.0,
        "share of the perceived misalignment that is corrected at once; the rest on the way to the target",
        "assumed: no source, hence the full range",
    ),
    "withdraw_mm": Trait(
        "mm", "fixed", 2.0, 0,
        "distance of withdrawal on an alarm",
        "assumed: well outside the contact zone of 0.7 mm",
    ),
    "hand_mass_kg": Trait(
        "kg", "fixed", 0.554, 0,
        "mass of hand and forearm in a force device",
        "one arm: van Beek, Bergmann Tiest, Mugge and Kappers 2015, Sci. Rep. 5:18004 (cited); that all are "
        "alike is assumed",
    ),
    "hand_damping_n_s_per_mm": Trait(
        "N s/mm", "fixed", 0.00645, 0,
        "damping of a hand that a force pushes",
        "as above",
    ),
    "hand_stiffness_n_per_mm": Trait(
        "N/mm", "fixed", 0.135, 0,
        "stiffness of a hand that a force pushes",
        "as above",
    ),
}  # fmt: skip
"""All traits of a participant, in the order in which they are drawn."""
OLD_TRAITS = {
    "touch_delay_s": "reaction_time_s", "busy_delay_s": "dual_task_delay_s",
    "glance_deviation_deg": "glance_sd_deg", "misjudgement_deg": "visual_bias_sd_deg",
    "distance_share": "distance_sd_share", "motor_share": "motor_sd_share",
    "direction_deg": "direction_sd_deg", "faintest": "absolute_threshold",
    "strength_share": "weber_fraction", "notices_share": "attention_probability",
}  # fmt: skip
"""Today's names of traits by those of earlier versions, which are still read."""


def trait_name(name: str, place: str) -> str:
    """Return today's name of a trait; warn if an earlier one was given.

    Raises:
        BadInput: If there is no such trait.
    """
    if name in OLD_TRAITS:
        message = f"{place}: trait {name!r} is now called {OLD_TRAITS[name]!r}"
        warnings.warn(message, RenamedKey, stacklevel=2)
        return OLD_TRAITS[name]
    if name not in TRAITS:
        raise BadInput(unknown_name("trait", name, TRAITS), place)
    return name


class Participant(Struct, frozen=True):
    """One simulated participant; `TRAITS` describes the fields and their sources."""

    number: int
    display_delay_s: float
    visual_delay_s: float
    actuator_delay_s: float
    reaction_time_s: float
    dual_task_delay_s: float
    glance_sd_deg: float
    visual_bias_sd_deg: float
    distance_sd_share: float
    pace_mm_s: float
    pace_deg_s: float
    throughput_bit_s: float
    plan_s: float
    motor_sd_share: float
    direction_sd_deg: float
    tremor_mm: float
    absolute_threshold: float
    weber_fraction: float
    attention_probability: float
    align_share: float
    withdraw_mm: float
    hand_mass_kg: float
    hand_damping_n_s_per_mm: float
    hand_stiffness_n_per_mm: float

    @property
    def visual_latency_s(self) -> float:
        """Delay from a motion of the tool to the hand's response to its image."""
        return self.display_delay_s + self.visual_delay_s

    @property
    def haptic_latency_s(self) -> float:
        """Delay from a command to the device to the hand's response."""
        return self.actuator_delay_s + self.reaction_time_s + self.dual_task_delay_s


def draw_participant(seed: int, number: int) -> Participant:
    """Draw a participant, who depends on seed and number only."""
    rng = np.random.default_rng((seed, 7, number))
    return Participant(number, **{name: trait.draw(rng) for name, trait in TRAITS.items()})


class Variation(Struct, frozen=True):
    """A modification of the drawn participants."""

    label: str
    factors: dict[str, float] = {}
    """Multipliers of the drawn values, by trait."""
    values: dict[str, float] = {}
    """Values that replace the drawn ones, by trait."""

    def __call__(self, participant: Participant) -> Participant:
        """Return the modified participant."""
        scaled = {name: factor * getattr(participant, name) for name, factor in self.factors.items()}
        return replace(participant, **scaled, **self.values)
