"""The simulated comparison of haptics: equal operators and seeds with no, binary and continuous touch.

Simulates one row per trial, and tests each measure. A trial depends on its own numbers only, so trials can be
simulated anywhere and in any order.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, pairwise

import numpy as np
from msgspec import Struct
from statsmodels.stats.multitest import multipletests

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.study.statistics.effects import matched_rank_biserial
from haptigraph.analysis.study.statistics.rank_tests import RankTest, signed_rank
from haptigraph.config import Config, SourceConfig
from haptigraph.messages import Step
from haptigraph.recording.writer import Progress
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH
from haptigraph.study.simulated.participant import Participant, draw_participant
from haptigraph.study.simulated.rehearsal import SHIPPED, Condition, Rehearsal, draw_scenario


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
    force_n: float = 0.0
    """Mean size of the force on the hand."""


MEASURES = {
    "theta_deg": ("Mean theta", "deg", 2),
    "completion_s": ("Completion time", "s", 1),
    "contacts": ("Unintended contacts", "per trial", 2),
    "near_misaligned_s": ("Misaligned near the retina", "s", 1),
    "far_aligned_s": ("Aligned before the approach", "s", 1),
    "vibrating_s": ("Time vibrating", "s", 1),
    "changes_per_min": ("Pattern changes", "per min", 1),
    "force_n": ("Mean force on the hand", "N", 2),
}
"""Measures by field: title, unit, decimals."""
RAW = Config(source=SourceConfig(jpeg_quality=0))  # nothing is recorded, so no compression
HAPTIC_MEASURES = ("vibrating_s", "changes_per_min", "force_n")
"""Where one is 0 by construction, without vibration or without force, it is not tested."""


class PairedTest(Struct, frozen=True):
    """The comparison of two conditions by one measure."""

    measure: str
    first: str
    second: str
    result: RankTest
    mean_difference: float
    """Second minus first."""
    effect: float
    """Matched-pairs rank-biserial correlation."""
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
        force_n=rehearsal.mean_force_n(start_ns, last_ns),
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
    """Return the mean over repetitions of each participant, by seed and participant number."""
    values: dict[tuple[int, int], list[float]] = {}
    for row in rows:
        if row.condition == condition:
            values.setdefault((row.seed, row.participant), []).append(float(getattr(row, measure)))
    return [float(np.mean(values[key])) for key in sorted(values)]


def by_seed(rows: Iterable[TouchTrial]) -> dict[int, list[TouchTrial]]:
    """Return the trials of every seed."""
    parts: dict[int, list[TouchTrial]] = {}
    for row in rows:
        parts.setdefault(row.seed, []).append(row)
    return parts


def paired_tests(rows: Sequence[TouchTrial]) -> list[PairedTest]:
    """Test every pair of conditions by every measure; all trials have one seed."""
    names = list(dict.fromkeys(row.condition for row in rows))
    tests = []
    for measure in MEASURES:
        values = {name: participant_values(rows, measure, name) for name in names}
        tested = [name for name in names if measure not in HAPTIC_MEASURES or any(values[name])]
        pairs = list(combinations(tested, 2))
        if not pairs:
            continue
        # Time stamps have 9 decimals, so differences are tied if they agree in these.
        pairwise_differences = [np.round(np.subtract(values[b], values[a]), 9) for a, b in pairs]
        results = [signed_rank(np.zeros(len(each)), each) for each in pairwise_differences]
        corrected = multipletests([result.p for result in results], method="holm")[1]
        for pair, each, result, p in zip(pairs, pairwise_differences, results, corrected, strict=True):
            mean, effect = float(each.mean()), float(matched_rank_biserial(each))
            tests.append(PairedTest(measure, *pair, result, mean, effect, float(p)))
    return tests
