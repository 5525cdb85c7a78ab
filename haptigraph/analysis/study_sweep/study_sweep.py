"""Simulate a study's trials with thousands of participants, also under variations of their traits.

Turns a protocol, a seed and variations into measured trials. A `SweepTask` is self-contained, so tasks run
anywhere and in any order. For exploration and sample-size estimates; there is no store and no recording.
"""

import math
from collections.abc import Sequence
from contextlib import ExitStack, closing
from itertools import product
from pathlib import Path
from typing import Any

from msgspec import Struct

from haptigraph.analysis.metrics.trial import measure_trial
from haptigraph.analysis.study_sweep.results import SweepResults
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.writer import Progress
from haptigraph.spreading.spread import spread
from haptigraph.spreading.tasks import Cluster, Killed
from haptigraph.study.plan import plan_of
from haptigraph.study.protocol import Protocol
from haptigraph.study.simulated.actions import TrialSpec, rehearse, trial_spec
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH
from haptigraph.study.simulated.participant import Variation, draw_participant, trait_name
from haptigraph.study.simulated.rehearsal import Rehearsal
from haptigraph.version import __version__

__all__ = ["AS_DRAWN", "Sweep", "SweepTask", "run_sweep", "run_task", "variations_of"]

AS_DRAWN = Variation("as drawn")
RESULTS = "results.db"
POSITIVE_TRAITS = ("pace_mm_s", "pace_deg_s", "throughput_bit_s", "plan_s")
"""At 0 a participant would never reach the target."""


class SweepTask(Struct, frozen=True):
    """All trials of one simulated participant under one variation."""

    study: str
    variation: Variation
    number: int
    seed: int
    perceiver: str
    trials: tuple[TrialSpec, ...]


class Sweep(Struct, frozen=True):
    """What is simulated."""

    protocol: Protocol
    participants: int
    seed: int
    variations: tuple[Variation, ...] = (AS_DRAWN,)
    perceiver: str = GROUND_TRUTH

    def task(self, variation: Variation, number: int) -> SweepTask:
        """Return one participant's trials, without training, as simulated participants do not learn."""
        plan = plan_of(self.protocol, number)
        trials = tuple(trial_spec(self.protocol, stage) for stage in plan if stage.kind == "trial")
        return SweepTask(self.protocol.study.name, variation, number, self.seed, self.perceiver, trials)

    def simulate(self, label: str, number: int) -> list[dict[str, Any]]:
        """Return the trials of one participant under the variation with a label."""
        variation = AS_DRAWN if label == AS_DRAWN.label else variations_of(label.split())[0]
        return run_task(self.task(variation, number))

    def about(self) -> dict[str, str]:
        """Return what every result depends on."""
        return {
            "study": self.protocol.study.name,
            "protocol_sha256": self.protocol.sha256,
            "seed": str(self.seed),
            "perceiver": self.perceiver,
            "haptigraph": __version__,
        }


def variations_of(arguments: Sequence[str]) -> tuple[Variation, ...]:
    """Return every combination of the given values, or participants as drawn.

    Args:
        arguments: TRAIT=VALUE,VALUE,... each; a value with the prefix x multiplies the drawn one.

    Raises:
        BadInput: If there is no such trait, or a value is not a valid number.
    """
    axes = [_axis(argument) for argument in arguments]
    traits = [axis[0][0] for axis in axes]
    for trait in traits:
        if traits.count(trait) > 1:
            raise BadInput(f"{trait} is varied twice; give all its values at once", "--vary")
    variations = []
    for choice in product(*axes):
        factors = {trait: number for trait, number, multiplies in choice if multiplies}
        values = {trait: number for trait, number, multiplies in choice if not multiplies}
        label = " ".join(f"{trait}={'x' * multiplies}{number:g}" for trait, number, multiplies in choice)
        variations.append(Variation(label, factors, values) if choice else AS_DRAWN)
    return tuple(variations)


def run_task(task: SweepTask) -> list[dict[str, Any]]:
    """Simulate and measure all trials of one participant; the same task gives bit-identical rows."""
    participant = task.variation(draw_participant(task.seed, task.number))
    return [
        _row(task, trial, rehearse(trial, participant, task.seed, task.perceiver)) for trial in task.trials
    ]


def run_sweep(
    sweep: Sweep,
    folder: Path,
    *,
    workers: int = 1,
    cluster: Cluster | None = None,
    progress: Progress | None = None,
) -> tuple[list[dict[str, Any]], int]:
    """Simulate the participants whose results are missing in a folder.

    Args:
        sweep: What is simulated.
        folder: Stores every result at once; created if it does not exist.
        workers: Number of processes on this machine.
        cluster: A Dask cluster to use instead of this machine.
        progress: Called with the number of complete participants.

    Returns:
        All trials, in order, and the number of participants simulated by this call.

    Raises:
        BadInput: If the folder contains results of a different sweep.
        HaptigraphError: If a participant repeatedly killed the worker.
    """
    report = progress or (lambda what, done, total: None)
    folder.mkdir(parents=True, exist_ok=True)
    total = len(sweep.variations) * sweep.participants
    with ExitStack() as stack:
        results = SweepResults(folder / RESULTS, sweep.about(), sweep.simulate)
        stack.enter_context(closing(results))
        stored = results.stored()
        missing = [
            (variation, number)
            for number in range(sweep.participants)
            for variation in sweep.variations
            if (variation.label, number) not in stored
        ]
        report("simulating participants", total - len(missing), total)
        tasks = (sweep.task(*each) for each in missing)
        finished = spread(run_task, tasks, workers=workers, cluster=cluster) if missing else ()
        for done, (task, trials) in enumerate(finished, 1):
            if isinstance(trials, Killed):
                raise HaptigraphError(f"participant {task.number + 1}: {trials.problem}")
            results.add(task.variation.label, task.number, trials)
            report("simulating participants", total - len(missing) + done, total)
        rows = [row for each in sweep.variations for row in results.trials(each.label, sweep.participants)]
    return rows, len(missing)


def _axis(argument: str) -> list[tuple[str, float, bool]]:
    name, equals, values = argument.partition("=")
    trait, axis = trait_name(name, "--vary"), []
    for value in values.split(",") if equals else ():
        multiplies = value.strip().startswith("x")
        try:
            number = float(value.strip().removeprefix("x"))
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number >= 0) or (number == 0 and trait in POSITIVE_TRAITS):
            valid = "above 0" if trait in POSITIVE_TRAITS else "of at least 0"
            problem = f"{trait}: expected a number {valid}, or one with the prefix x, found {value!r}"
            raise BadInput(problem, "--vary")
        axis.append((trait, number, multiplies))
    if not axis:
        raise BadInput(f"found {argument!r}; expected TRAIT=VALUE,VALUE,...", "--vary")
    return list(dict.fromkeys(axis))


def _row(task: SweepTask, trial: TrialSpec, rehearsal: Rehearsal) -> dict[str, Any]:
    """Simulate a trial; return a row like those of an exported table of trials."""
    procedure = rehearsal.procedure
    states, has_haptics = [state.name for state in procedure.states], trial.condition.max_amplitude > 0
    measures = measure_trial(rehearsal.steps(), states, has_haptics=has_haptics, span=procedure.span)
    stage = trial.stage
    return {
        "study": task.study,
        "variation": task.variation.label,
        "simulated": 1,
        "participant": f"S{task.number + 1:05}",
        "condition": stage.condition,
        "position": stage.position,
        "block": stage.block,
        "phase": stage.kind,
        "trial": stage.trial,
        "attempt": 1,
        "target": stage.target,
        "seed": stage.seed,
        "outcome": "hit" if rehearsal.is_hit else "timeout",
        "completion_s": None,
        "mean_theta_deg": None,
        **measures,
        "steered_s": rehearsal.steered_s,
        "software": __version__,
    }
