"""Simulated participants: the numbers an operator is made of, each with unit, distribution and source.

Turns a seed and a number into one participant. None of the numbers is fitted to a result; where no source
was found, it says "assumed". "(cited)": the value was read in an abstract or excerpt of the source;
"(standard)": a value that is usually given with this source and was not looked up again.
"""

import math
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

__all__ = ["TRAITS", "Participant", "Trait", "Variation", "draw_participant"]


class Trait(Struct, frozen=True):
    """How one number differs between participants."""

    unit: str
    law: Literal["fixed", "normal", "uniform", "lognormal"]
    a: float
    """The value; the mean; the least; the median."""
    b: float
    """Nothing; the standard deviation; the most; the deviation of the logarithm."""
    says: str
    source: str

    def draw(self, rng: np.random.Generator) -> float:
        """Draw one participant's number; normal ones stay within two deviations, so that none is absurd."""
        if self.law == "normal":
            return self.a + self.b * float(np.clip(rng.standard_normal(), -2, 2))
        if self.law == "lognormal":
            return self.a * math.exp(self.b * float(np.clip(rng.standard_normal(), -2, 2)))
        chance = rng.uniform(self.a, self.b) if self.law == "uniform" else self.a
        return float(chance)

    @property
    def spread(self) -> str:
        """The distribution, in words."""
        if self.law == "fixed":
            return f"{self.a:g}"
        words = {
            "normal": "{} ± {}, cut at 2 SD",
            "uniform": "{} to {}",
            "lognormal": "median {}, SD of log {}",
        }
        return words[self.law].format(f"{self.a:g}", f"{self.b:g}")


TRAITS: dict[str, Trait] = {
    "display_delay_s": Trait(
        "s", "fixed", 0.1, 0,
        "from a motion of the tool to its picture on the screen",
        "camera 66 ms (RealSense D435, realsense-ros issue 2686, cited) and one image of 33 ms",
    ),
    "visual_delay_s": Trait(
        "s", "uniform", 0.13, 0.2,
        "from the picture to a correction of the hand",
        "Saunders and Knill 2005, Exp. Brain Res. 162: 130 to 200 ms for distance (cited)",
    ),
    "actuator_delay_s": Trait(
        "s", "fixed", 0.015, 0,
        "until an actuator moves",
        "linear resonant actuators 10 to 20 ms (TDK white paper, Mouser; cited)",
    ),
    "touch_delay_s": Trait(
        "s", "normal", 0.213, 0.027,
        "simple reaction time, taken as equal for touch and sight",
        "Woods et al. 2015, Front. Hum. Neurosci. 9:131 (standard); equal for touch: 'Accurate "
        "reaction time methods demonstrate similar results', josam.org 2021 (cited)",
    ),
    "busy_delay_s": Trait(
        "s", "fixed", 0.13, 0,
        "added to it while steering",
        "Bao et al. 2019, PLOS ONE 14(8):e0219737: a second task costs more than 130 ms (cited)",
    ),
    "glance_sd_deg": Trait(
        "deg", "uniform", 1.2, 2.4,
        "of the seen angle between shaft and target, per look",
        "0.6 deg at the cardinal directions ('Recognition of stimulus orientation', Vision Res. 30, 1990; "
        "cited), 2 to 4 times that for oblique lines (Appelle 1972, Psychol. Bull. 78; cited)",
    ),
    "misjudgement_deg": Trait(
        "deg", "uniform", 1.2, 2.4,
        "deviation of the error that stays for a whole trial",
        "assumed as large as the deviation of a look; that there are such biases: Bouma and Andriessen 1968, "
        "Vision Res. 8",
    ),
    "distance_share": Trait(
        "1", "uniform", 0.02, 0.06,
        "deviation of a seen distance, as a share of it",
        "difference threshold of lengths, some 4 % (Ono 1967, Percept. Psychophys. 2; standard)",
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
        "no movement is quicker than Fitts's law with it",
        "joystick 1.8 bit/s (MacKenzie, Kauppinen and Silfverberg 2001, CHI; standard); spread assumed",
    ),
    "plan_s": Trait(
        "s", "fixed", 0.5, 0,
        "a movement goes on so long before the next is planned",
        "intermittent control, two corrections a second (Craik 1947, Br. J. Psychol. 38; standard)",
    ),
    "motor_share": Trait(
        "1", "normal", 0.103, 0.02,
        "deviation of a movement's size, as a share of it",
        "signal-dependent noise 0.103 (van Beers, Haggard and Wolpert 2004, J. Neurophysiol. 91; standard); "
        "spread assumed",
    ),
    "direction_deg": Trait(
        "deg", "normal", 3.5, 0.5,
        "deviation of a movement's direction",
        "3 to 4 deg (Gordon, Ghilardi and Ghez 1994, Exp. Brain Res. 99; standard)",
    ),
    "tremor_mm": Trait(
        "mm", "uniform", 0.05, 0.2,
        "tremor of the hand, RMS per axis, 8 to 12 Hz",
        "50 to 200 µm, 8 to 12 Hz (PMC3989364; cited)",
    ),
    "faintest": Trait(
        "amplitude", "fixed", 0.05, 0,
        "weaker vibration is not felt",
        "assumed: a third of the weakest pattern of the shipped procedures",
    ),
    "strength_share": Trait(
        "1", "fixed", 0.2, 0,
        "deviation of a felt strength, as a share of it",
        "difference threshold 0.20 at the thenar eminence, 125 Hz ('Vibrotactile difference thresholds', "
        "IEEE Trans. Haptics 2012; cited)",
    ),
    "notices_share": Trait(
        "1", "uniform", 0.84, 1.0,
        "chance, per planned movement, that touch is attended to",
        "tactile commands during another task: 92 % right ('Vibrotactile pattern recognition on the arm and "
        "back', Perception 38, 2009; cited); spread assumed",
    ),
    "align_share": Trait(
        "1", "uniform", 0.0, 1.0,
        "how much of the seen misalignment is turned away at once; the rest on the way to the target",
        "assumed: no source, so everything between the extremes",
    ),
    "withdraw_mm": Trait(
        "mm", "fixed", 2.0, 0,
        "how far the tool is drawn back on an alarm",
        "assumed: well out of the contact zone of 0.7 mm",
    ),
}  # fmt: skip
"""Every number of a participant."""


class Participant(Struct, frozen=True):
    """One simulated participant; `TRAITS` says what the numbers are and where they come from."""

    number: int
    display_delay_s: float
    visual_delay_s: float
    actuator_delay_s: float
    touch_delay_s: float
    busy_delay_s: float
    glance_sd_deg: float
    misjudgement_deg: float
    distance_share: float
    pace_mm_s: float
    pace_deg_s: float
    throughput_bit_s: float
    plan_s: float
    motor_share: float
    direction_deg: float
    tremor_mm: float
    faintest: float
    strength_share: float
    notices_share: float
    align_share: float
    withdraw_mm: float

    @property
    def sight_s(self) -> float:
        """From a motion of the tool to the hand's answer to its picture."""
        return self.display_delay_s + self.visual_delay_s

    @property
    def feeling_s(self) -> float:
        """From a command to the device to the hand's answer."""
        return self.actuator_delay_s + self.touch_delay_s + self.busy_delay_s


def draw_participant(seed: int, number: int) -> Participant:
    """Draw a participant; the same seed and number give the same one, however many others there are."""
    rng = np.random.default_rng((seed, 7, number))
    return Participant(number, **{name: trait.draw(rng) for name, trait in TRAITS.items()})


class Variation(Struct, frozen=True):
    """Participants that are other than they were drawn."""

    says: str
    factors: dict[str, float] = {}
    """By trait: what its value is multiplied by."""
    values: dict[str, float] = {}
    """By trait: what it is instead."""

    def __call__(self, who: Participant) -> Participant:
        """Return the participant as changed."""
        scaled = {name: factor * getattr(who, name) for name, factor in self.factors.items()}
        return replace(who, **scaled, **self.values)
