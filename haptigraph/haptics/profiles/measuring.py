"""How a person measures a device: from answers about vibrations to thresholds and intensities. Pure.

`ask` plays a trial and returns the answer; a terminal, a page or a simulated person. Drives are shares of the
largest drive of the session.
"""

import math
import random
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.errors import HaptigraphError
from haptigraph.haptics.profiles.profile import Point
from haptigraph.haptics.profiles.threshold import (
    Answered,
    Threshold,
    estimate_threshold,
    is_catch,
    next_amplitude,
)

__all__ = [
    "FULL_ON_MS",
    "NUMBER",
    "Ask",
    "Burst",
    "Trial",
    "Unusable",
    "drives_between",
    "find_onset",
    "find_threshold",
    "increasing",
    "match_intensities",
    "rate_intensities",
]

THRESHOLD_STIMULI, ONSET_STIMULI, MATCHES = 40, 40, 25
RATINGS = 8
T_975 = 2.365
"""Of Student's distribution with `RATINGS` - 1 degrees of freedom, for 95 %."""
MIN_RATINGS = 6
ROUNDING = 0.005  # of a rating in whole numbers: equal answers are not exact
FULL_ON_MS = 500.0
RELIABLE = 0.75
"""How often the shortest burst is felt."""
DRIVES = 5
NUMBER = ("0 to 200",)
"""The choices of a trial that is answered with a number."""
DB = math.log(10) / 20


class Unusable(HaptigraphError):
    """The answers do not say what was to be measured."""


class Burst(Struct, frozen=True):
    """One vibration of a trial."""

    output: Literal["device", "reference"]
    drive: float
    """0: silence."""
    on_ms: float = FULL_ON_MS


class Trial(Struct, frozen=True):
    """One question, and what is played before it."""

    task: Literal["threshold", "onset", "match", "rate"]
    number: int
    """From 1."""
    of: int
    bursts: tuple[Burst, ...]
    """In order."""
    question: str
    choices: tuple[str, ...]
    """Valid answers, or `NUMBER`."""


Ask: TypeAlias = Callable[[Trial], str]


def find_threshold(ask: Ask, output: Literal["device", "reference"], seed: int) -> Threshold:
    """Measure the drive that is felt half of the time; one of five stimuli is silent.

    Raises:
        Unusable: If it is outside the drives that can be played.
    """

    def burst(share: float) -> Burst:
        return Burst(output, share)

    threshold = estimate_threshold(_felt_or_not(ask, "threshold", burst, THRESHOLD_STIMULI, seed))
    if not threshold.is_known:
        felt = f"{threshold.false_alarms} of {threshold.catch_trials} silent stimuli were felt"
        raise Unusable(
            f"the threshold is outside the drives that were played, or the answers were guesses ({felt})"
        )
    return threshold


def find_onset(ask: Ask, drive: float, seed: int, interval_ms: float = 0.0) -> Threshold | None:
    """Measure the burst that is felt three times of four, relative to `FULL_ON_MS`; None if longer than that.

    Args:
        ask: Plays a trial.
        drive: Of the bursts.
        seed: Of the silent ones.
        interval_ms: No burst is shorter than this.
    """

    def burst(share: float) -> Burst:
        return Burst("device", drive if share else 0.0, share * FULL_ON_MS or FULL_ON_MS)

    answers = _felt_or_not(ask, "onset", burst, ONSET_STIMULI, seed, interval_ms / FULL_ON_MS)
    onset = estimate_threshold(answers, RELIABLE)
    return onset if onset.high <= 1 else None


def drives_between(lowest: float, largest: float) -> list[float]:
    """Return drives from well above the lowest to the largest, in equal ratios."""
    return [lowest * (largest / lowest) ** (step / (DRIVES + 1)) for step in range(2, DRIVES + 2)]


def match_intensities(ask: Ask, threshold: Threshold, seed: int) -> list[Point]:
    """Find, for several drives of the device, the amplitude of the reference that feels as strong.

    The amplitude of the reference adapts to the answers, as for a threshold; which of the two is played first
    is random. If the device can feel stronger than the reference, its drive is found that feels like the
    reference's full amplitude, and no larger one is used.

    Args:
        ask: Plays a trial.
        threshold: Of the device.
        seed: Of the order within a pair.
    """
    matching = _Matching(ask, seed)
    strongest = matching.equal(Burst("device", 1.0), "reference")
    is_stronger = strongest.amplitude > 1
    largest = matching.equal(Burst("reference", 1.0), "device") if is_stronger else None
    *drives, last = drives_between(threshold.high, min(largest.amplitude, 1.0) if largest else 1.0)
    points = [_matched(drive, matching.equal(Burst("device", drive), "reference")) for drive in drives]
    if largest is None:
        return increasing([*points, _matched(last, strongest)])
    points = [point for point in points if point.intensity < 1]
    if not points:
        raise Unusable("weak vibrations of the device were said to be stronger than the reference can be")
    steepness = -math.log(points[0].intensity) / math.log(last / points[0].drive)  # over all: less noisy
    return increasing([*points, Point(last, 1.0, min(steepness * DB * largest.sd_db, 1.0))])


def rate_intensities(ask: Ask, threshold: Threshold, seed: int) -> list[Point]:
    """Let the person rate every drive relative to the strongest, which is 100 and played before each.

    Magnitude estimation with a standard (Stevens 1975, Psychophysics). The intensity is the geometric mean of
    the ratings, with its standard deviation. The largest drive has intensity 1 by definition.

    Args:
        ask: Plays a trial.
        threshold: Of the device.
        seed: Of the order.
    """
    *weaker, strongest = drives_between(threshold.high, 1.0)
    order = [drive for drive in weaker for _ in range(RATINGS)]
    random.Random(seed).shuffle(order)
    ratings: dict[float, list[float]] = {drive: [] for drive in weaker}
    for number, drive in enumerate(order, 1):
        bursts = Burst("device", strongest), Burst("device", drive)
        question = "The first is 100. How strong was the second? (0: not felt)"
        ratings[drive].append(float(ask(Trial("rate", number, len(order), bursts, question, NUMBER))))
    points = [_rated(drive, [each for each in given if each > 0]) for drive, given in ratings.items()]
    return increasing([*(point for point in points if point is not None), Point(strongest, 1.0, 0.0)])


def increasing(points: Sequence[Point]) -> list[Point]:
    """Return points in which drive and intensity both increase; neighbours that do not are pooled.

    Pooled points have the weighted geometric means of both; the standard deviation includes their difference.
    A last point without uncertainty, which is defined and not measured, stays as it is.

    Raises:
        Unusable: If fewer than two points are left.
    """
    pooled: list[Point] = []
    for point in points:
        added: Point | None = point
        while added and pooled and added.intensity <= pooled[-1].intensity:
            before = pooled.pop()
            added = added if not added.sd else _pooled(before, added)
        pooled.append(added or point)
    if len(pooled) < 2:
        raise Unusable("the answers do not order the drives by strength; nothing can be concluded from them")
    return pooled


class _Matching:
    """Comparisons of device and reference, and their count."""

    def __init__(self, ask: Ask, seed: int) -> None:
        self._ask, self._random, self._count = ask, random.Random(seed), 0

    def equal(self, fixed: Burst, varied: Literal["device", "reference"]) -> Threshold:
        """Return the drive of one output that feels as strong as a burst of the other."""
        answers: list[Answered] = []
        of = self._count + MATCHES
        for _ in range(MATCHES):
            self._count += 1
            drive = next_amplitude(answers, compares=True)
            pair = [fixed, Burst(varied, drive)]
            self._random.shuffle(pair)
            question = "Which was stronger, the first or the second? (1, 2)"
            answer = self._ask(Trial("match", self._count, of, tuple(pair), question, ("1", "2")))
            answers.append(Answered(drive, pair[int(answer) - 1].output == varied))
        return estimate_threshold(answers, compares=True)


def _matched(drive: float, equal: Threshold) -> Point:
    intensity = min(equal.amplitude, 1.0)
    return Point(drive, intensity, min(intensity * DB * equal.sd_db, 1.0))


def _felt_or_not(
    ask: Ask,
    task: Literal["threshold", "onset"],
    burst: Callable[[float], Burst],
    count: int,
    seed: int,
    least: float = 0.0,
) -> list[Answered]:
    """Ask whether bursts are felt; `burst` makes one of a share of the full drive or length, 0: silence."""
    answers: list[Answered] = []
    for number in range(1, count + 1):
        share = 0.0 if is_catch(number, seed, task) else max(next_amplitude(answers), least)
        trial = Trial(task, number, count, (burst(share),), "Did you feel it? (y, n)", ("y", "n"))
        answers.append(Answered(share, ask(trial) == "y"))
    return answers


def _rated(drive: float, given: Sequence[float]) -> Point | None:
    """Return the point of a drive; None if it was often not felt."""
    if len(given) < MIN_RATINGS:
        return None
    logs = [math.log(each / 100) for each in given]
    mean = sum(logs) / len(logs)
    sd = math.sqrt(sum((each - mean) ** 2 for each in logs) / (len(logs) - 1) / len(logs)) * T_975 / 1.96
    intensity = min(math.exp(mean), 1.0)
    return Point(drive, intensity, min(max(sd * intensity, ROUNDING), 1.0))


def _pooled(one: Point, other: Point) -> Point:
    weights = (one.intensity / one.sd) ** 2, (other.intensity / other.sd) ** 2

    def mean(a: float, b: float) -> float:
        return math.exp((weights[0] * math.log(a) + weights[1] * math.log(b)) / sum(weights))

    intensity = mean(one.intensity, other.intensity)
    sd = max(intensity / math.sqrt(sum(weights)), abs(one.intensity - other.intensity) / 2)
    return Point(mean(one.drive, other.drive), intensity, sd)
