"""A study's trials by thousands of simulated participants, and by others than they were drawn.

Turns a protocol, a seed and variations of the participants into measured trials. A participant needs nothing
but its own `Part`, so parts can be played anywhere and in any order. No store, no recording: for looking
around, and for how many people a study needs. All is simulated.
"""

import math
from collections.abc import Sequence
from contextlib import ExitStack, closing
from itertools import product
from pathlib import Path
from typing import Any

from msgspec import Struct

from haptigraph.analysis.metrics.trial import measure_trial
from haptigraph.analysis.study_sweep.cluster import spread
from haptigraph.analysis.study_sweep.results import SweepResults
from haptigraph.errors import BadInput, unknown_name
from haptigraph.recording.writer import Progress
from haptigraph.study.plan import plan_of
from haptigraph.study.protocol import Protocol
from haptigraph.study.simulated.actions import Act, act_of, rehearse
from haptigraph.study.simulated.participant import TRAITS, Variation, draw_participant
from haptigraph.study.simulated.rehearsal import KNOWN, Rehearsal
from haptigraph.version import __version__

__all__ = ["AS_DRAWN", "Part", "Sweep", "play_part", "run_sweep", "variations_of"]

AS_DRAWN = Variation("as drawn")
RESULTS = "results.db"
NEVER_0 = ("pace_mm_s", "pace_deg_s", "throughput_bit_s", "plan_s")
"""Who moves at no pace never arrives."""


class Part(Struct, frozen=True):
    """All that one simulated participant of one variation does."""

    study: str
    variation: Variation
    number: int
    seed: int
    perceiver: str
    acts: tuple[Act, ...]


class Sweep(Struct, frozen=True):
    """What is to be played."""

    protocol: Protocol
    participants: int
    seed: int
    variations: tuple[Variation, ...] = (AS_DRAWN,)
    perceiver: str = KNOWN

    def part(self, variation: Variation, number: int) -> Part:
        """Return what one participant does; training is left out, as nobody learns from it."""
        plan = plan_of(self.protocol, number)
        acts = tuple(act_of(self.protocol, stage) for stage in plan if stage.kind == "trial")
        return Part(self.protocol.study.name, variation, number, self.seed, self.perceiver, acts)

    def about(self) -> dict[str, str]:
        """Return what every result depends on."""
        return {
            "study": self.protocol.study.name,
            "protocol_sha256": self.protocol.sha256,
            "seed": str(self.seed),
            "perceiver": self.perceiver,
            "haptigraph": __version__,
        }


def variations_of(asked: Sequence[str]) -> tuple[Variation, ...]:
    """Return every combination of what is asked, or participants as they are drawn.

    Args:
        asked: TRAIT=VALUE,VALUE,... each; a value with an x before it multiplies what was drawn.

    Raises:
        BadInput: If there is no such trait, or a value is no number.
    """
    axes = [_axis(each) for each in asked]
    traits = [axis[0][0] for axis in axes]
    for trait in traits:
        if traits.count(trait) > 1:
            raise BadInput(f"{trait} is varied twice; give all its values at once", "--vary")
    found = []
    for choice in product(*axes):
        factors = {trait: number for trait, number, multiplies in choice if multiplies}
        values = {trait: number for trait, number, multiplies in choice if not multiplies}
        says = " ".join(f"{trait}={'x' * multiplies}{number:g}" for trait, number, multiplies in choice)
        found.append(Variation(says, factors, values) if choice else AS_DRAWN)
    return tuple(found)


def play_part(part: Part) -> list[dict[str, Any]]:
    """Play and measure all trials of one participant; the same part gives the same rows, bit for bit."""
    who = part.variation(draw_participant(part.seed, part.number))
    return [_row(part, act, rehearse(act, who, part.seed, part.perceiver)) for act in part.acts]


def run_sweep(
    sweep: Sweep, folder: Path, *, workers: int = 1, scheduler: str = "", progress: Progress | None = None
) -> tuple[list[dict[str, Any]], int]:
    """Play whatever is missing in a folder of results.

    Args:
        sweep: What is to be played.
        folder: Keeps every result as soon as it is there; made if absent.
        workers: Processes on this machine.
        scheduler: Address of a Dask cluster's scheduler, in place of this machine.
        progress: Told how many participants are through.

    Returns:
        All trials, in order; and how many participants were played now.

    Raises:
        BadInput: If the folder has results of something else.
    """
    report = progress or (lambda what, done, total: None)
    folder.mkdir(parents=True, exist_ok=True)
    total = len(sweep.variations) * sweep.participants
    with ExitStack() as stack:
        results = stack.enter_context(closing(SweepResults(folder / RESULTS, sweep.about())))
        there = results.there()
        missing = [
            (variation, number)
            for number in range(sweep.participants)
            for variation in sweep.variations
            if (variation.says, number) not in there
        ]
        report("simulating participants", total - len(missing), total)
        parts = (sweep.part(*each) for each in missing)
        played = spread(play_part, parts, workers=workers, scheduler=scheduler) if missing else ()
        for done, (part, trials) in enumerate(played, 1):
            _check_version(trials, scheduler)
            results.keep(part.variation.says, part.number, trials)
            report("simulating participants", total - len(missing) + done, total)
        rows = [row for each in sweep.variations for row in results.trials(each.says, sweep.participants)]
    return rows, len(missing)


def _axis(asked: str) -> list[tuple[str, float, bool]]:
    trait, equals, values = asked.partition("=")
    if trait not in TRAITS:
        raise BadInput(unknown_name("trait", trait, TRAITS), "--vary")
    axis = []
    for value in values.split(",") if equals else ():
        multiplies = value.strip().startswith("x")
        try:
            number = float(value.strip().removeprefix("x"))
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number >= 0) or (number == 0 and trait in NEVER_0):
            least = "above 0" if trait in NEVER_0 else "of at least 0"
            problem = f"{trait}: expected a number {least}, or one with an x before it, found {value!r}"
            raise BadInput(problem, "--vary")
        axis.append((trait, number, multiplies))
    if not axis:
        raise BadInput(f"found {asked!r}; expected TRAIT=VALUE,VALUE,...", "--vary")
    return list(dict.fromkeys(axis))


def _row(part: Part, act: Act, rehearsal: Rehearsal) -> dict[str, Any]:
    """Play a trial, and return a line of a study's table of trials, as an export has it."""
    steps, procedure = list(rehearsal.steps()), rehearsal.procedure
    states, touch = [state.name for state in procedure.states], act.condition.max_amplitude > 0
    measures = measure_trial(steps, states, touch=touch, span=procedure.span)
    stage = act.stage
    return {
        "study": part.study,
        "variation": part.variation.says,
        "simulated": 1,
        "participant": f"S{part.number + 1:05}",
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
        "steered_s": steps[-1].stamp_ns / 1e9,
        "software": __version__,
    }


def _check_version(trials: list[dict[str, Any]], scheduler: str) -> None:
    others = {str(row["software"]) for row in trials} - {__version__}
    if others:
        problem = f"its workers have haptigraph {others.pop()}, here is {__version__}; use the same"
        raise BadInput(problem, scheduler)
