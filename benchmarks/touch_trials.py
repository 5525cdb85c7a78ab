"""The simulated comparison of haptics: equal operators and seeds with no, binary and continuous touch.

Simulates one row per trial, and tests each measure. A trial depends on its own numbers only, so trials can be
simulated anywhere and in any order.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, pairwise

import numpy as np
from msgspec import Struct

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.config import Config, SourceConfig
from haptigraph.errors import MissingExtra
from haptigraph.messages import Step
from haptigraph.recording.writer import Progress
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH
from haptigraph.study.simulated.participant import Participant, draw_participant
from haptigraph.study.simulated.rehearsal import SHIPPED, Condition, Rehearsal, draw_scenario

EXACT_UP_TO = 50  # pairs without ties, for which SciPy tabulates the distribution
ALL_SIGNS_UP_TO = 16  # pairs with ties: all 2 ** 16 sign patterns are enumerated


class SignedRank(Struct, frozen=True):
    """One Wilcoxon signed-rank test, two-sided (Wilcoxon 1945)."""

    pairs: int
    zeros: int
    """Number of pairs without a difference, which are dropped (Wilcoxon 1945)."""
    statistic: float
    """The smaller rank sum; nan if no pair differs."""
    p: float
    """1 if no pair differs."""
    variant: str
    """The method of computing p."""
    mean_difference: float
    """Second minus first."""
    effect: float
    """Matched-pairs rank-biserial correlation (Kerby 2014), from -1 to 1."""


def signed_rank(first: Sequence[float], second: Sequence[float]) -> SignedRank:
    """Compare two paired samples.

    Args:
        first: Values under one condition, (n,).
        second: Those of the same participants under another.

    Raises:
        MissingExtra: If SciPy is not installed.
    """
    try:
        from scipy import stats
    except ImportError:
        raise MissingExtra("the comparison's statistics", "analysis") from None
    difference = np.round(np.subtract(second, first, dtype=np.float64), 9)  # so that ties survive rounding
    nonzero = difference[difference != 0]
    mean = float(difference.mean())
    zeros = len(difference) - len(nonzero)
    if not len(nonzero):
        return SignedRank(len(difference), zeros, math.nan, 1.0, "no pair differs", mean, 0.0)
    ranks = stats.rankdata(np.abs(nonzero))
    effect = float((ranks * np.sign(nonzero)).sum() / ranks.sum())
    has_ties = len(np.unique(np.abs(nonzero))) < len(nonzero)
    if not has_ties and len(nonzero) <= EXACT_UP_TO:
        result, variant = stats.wilcoxon(nonzero, method="exact"), "exact"
    elif len(nonzero) <= ALL_SIGNS_UP_TO:
        every = stats.PermutationMethod(n_resamples=np.inf)
        result, variant = stats.wilcoxon(nonzero, method=every), "exact over all signs, mid-ranks"
    else:
        result = stats.wilcoxon(nonzero, method="asymptotic", correction=True)
        variant = "normal, mid-ranks, continuity corrected"
    return SignedRank(
        len(difference), zeros, float(result.statistic), float(result.pvalue), variant, mean, effect
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for multiple testing (Holm 1979, Scand. J. Stat. 6), in the same order."""
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[int(index)] = largest
    return adjusted


class TouchTrial(Struct, frozen=True):
    """One trial, measured from the tip's entry into the globe to the first Target Hit."""

    participant: int
    condition: str
    repetition: int
    seed: int
    perceiver: str
    hit: bool
    """Whether the target was hit in time; if not, the measures cover the whole trial."""
    theta_deg: float
    """Mean, as estimated by the pipeline."""
    completion_s: float
    contacts: int
    near_misaligned_s: float
    """Time in Misaligned Retinal Approach."""
    far_aligned_s: float
    """Time in Aligned Intraocular Navigation: aligned before the approach."""
    vibrating_s: float
    """Time with vibration."""
    changes_per_min: float
    """Rate of pattern changes, including those to and from silence."""


MEASURES = {
    "theta_deg": ("Mean theta", "deg", 2),
    "completion_s": ("Completion time", "s", 1),
    "contacts": ("Unintended contacts", "per trial", 2),
    "near_misaligned_s": ("Misaligned near the retina", "s", 1),
    "far_aligned_s": ("Aligned before the approach", "s", 1),
    "vibrating_s": ("Time vibrating", "s", 1),
    "changes_per_min": ("Pattern changes", "per min", 1),
}
"""Measures by field: title, unit, decimals."""
RAW = Config(source=SourceConfig(jpeg_quality=0))  # nothing is recorded, so no compression
HAPTIC_MEASURES = ("vibrating_s", "changes_per_min")
"""They are 0 by construction without touch, so that is not tested."""


class PairedTest(Struct, frozen=True):
    """The comparison of two conditions by one measure."""

    measure: str
    first: str
    second: str
    result: SignedRank
    holm_p: float
    """p corrected over the comparisons of the same measure."""


def compare_touch(
    participants: int,
    repetitions: int,
    seed: int,
    *,
    conditions: Sequence[Condition] = SHIPPED,
    perceiver: str = GROUND_TRUTH,
    change: Callable[[Participant], Participant] | None = None,
    progress: Progress | None = None,
) -> list[TouchTrial]:
    """Simulate every trial: participants x repetitions x conditions.

    Args:
        participants: Number of participants.
        repetitions: Trials per participant and condition, each with another target.
        seed: Of all random numbers.
        conditions: The compared conditions.
        perceiver: Name of a perceiver on rendered images, or `GROUND_TRUTH`.
        change: Modifies the drawn participants.
        progress: Called with the progress.
    """
    rows: list[TouchTrial] = []
    total = participants * repetitions * len(conditions)
    for number in range(participants):
        participant = draw_participant(seed, number)
        participant = change(participant) if change else participant
        for repetition in range(repetitions):
            for condition in conditions:
                if progress is not None:
                    progress("simulating trials", len(rows), total)
                rows.append(play_trial(participant, condition, repetition, seed, perceiver=perceiver))
    return rows


def play_trial(
    participant: Participant,
    condition: Condition,
    repetition: int,
    seed: int,
    *,
    perceiver: str = GROUND_TRUTH,
) -> TouchTrial:
    """Simulate and measure one trial; equal arguments give bit-identical rows."""
    seeds = seed, 8, participant.number, repetition
    rehearsal = Rehearsal(
        participant, condition, draw_scenario(seeds), seeds, perceiver=perceiver, config=RAW
    )
    measures = RunMeasures.under(rehearsal.procedure)
    changes = _PatternChanges(is_active=condition.max_amplitude > 0)
    for step in rehearsal.steps():
        measures.add(step)
        changes.add(step, measures)
    vibrating_s, per_min = measure_trial(measures, rehearsal.output, changes.count)
    last_ns = measures.last.stamp_ns if measures.last else 0
    start_ns = last_ns if measures.started_ns is None else measures.started_ns
    return TouchTrial(
        participant=participant.number,
        condition=condition.name,
        repetition=repetition,
        seed=seed,
        perceiver=perceiver,
        hit=measures.ended_ns is not None,
        theta_deg=float("nan") if measures.mean_theta_deg is None else measures.mean_theta_deg,
        completion_s=measures.completion_s or (last_ns - start_ns) / 1e9,
        contacts=measures.contacts,
        near_misaligned_s=measures.state_s.get("misaligned_retinal_approach", 0.0),
        far_aligned_s=measures.state_s.get("aligned_intraocular_navigation", 0.0),
        vibrating_s=vibrating_s,
        changes_per_min=per_min,
    )


def measure_trial(
    measures: RunMeasures, output: Sequence[tuple[int, float]], changes: int
) -> tuple[float, float]:
    """Return the time with vibration in the run [s], and the rate of pattern changes [per min].

    Args:
        measures: Of the run, for its start and end.
        output: Every change of the device's output, (stamp_ns, amplitude), in order.
        changes: Number of pattern changes in the run.
    """
    if measures.started_ns is None or measures.last is None:
        return 0.0, 0.0
    start_ns, end_ns = measures.started_ns, measures.ended_ns or measures.last.stamp_ns
    vibrating_ns = sum(
        max(min(until_ns, end_ns) - max(since_ns, start_ns), 0)
        for (since_ns, amplitude), (until_ns, _) in pairwise([*output, (end_ns, 0.0)])
        if amplitude > 0
    )
    minutes = (end_ns - start_ns) / 60e9
    return vibrating_ns / 1e9, changes / minutes if minutes else 0.0


class _PatternChanges:
    """Count the pattern changes in a run."""

    def __init__(self, is_active: bool) -> None:
        self.count = 0
        self._is_active = is_active
        self._last: str | None = None

    def add(self, step: Step, measures: RunMeasures) -> None:
        if not (self._is_active and measures.is_running):
            return
        name = step.command.pattern.name
        self.count += self._last is not None and name != self._last
        self._last = name


def participant_values(rows: Iterable[TouchTrial], measure: str, condition: str) -> list[float]:
    """Return the mean over repetitions of each participant, by participant number."""
    values: dict[int, list[float]] = {}
    for row in rows:
        if row.condition == condition:
            values.setdefault(row.participant, []).append(float(getattr(row, measure)))
    return [float(np.mean(values[number])) for number in sorted(values)]


def paired_tests(rows: Sequence[TouchTrial]) -> list[PairedTest]:
    """Test every pair of conditions by every measure.

    Raises:
        MissingExtra: If SciPy is not installed.
    """
    names = list(dict.fromkeys(row.condition for row in rows))
    tests = []
    for measure in MEASURES:
        is_haptic = measure in HAPTIC_MEASURES
        pairs = [pair for pair in combinations(names, 2) if not (is_haptic and "no touch" in pair)]
        results = [
            signed_rank(*(participant_values(rows, measure, condition) for condition in pair))
            for pair in pairs
        ]
        corrected = holm([result.p for result in results])
        tests += [
            PairedTest(measure, *pair, result, p)
            for pair, result, p in zip(pairs, results, corrected, strict=True)
        ]
    return tests
