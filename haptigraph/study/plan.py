"""The plan of one participant: all stages in order, from protocol and slot.

Pure: the same protocol and slot give the same plan at every station and after every crash. The store holds
which stages are done.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.checksum import hashed_integer
from haptigraph.study.conditions import order_of, round_of, targets_of
from haptigraph.study.preparation.calibration import Task
from haptigraph.study.protocol import Protocol, StudyTable, Trials

__all__ = ["Kind", "Stage", "attempt_seed", "condition_title", "conditions_of", "inseparable", "plan_of"]

DRAWS = 64  # of the targets, until they are balanced over conditions
DRAWN_PLANS = 4096  # in all of them; the more participants, the less a draw matters

Kind: TypeAlias = Literal[
    "briefing", "consent", "questionnaire", "calibration", "training", "trial", "break", "thanks"
]


class Stage(Struct, frozen=True):
    """One step of a participant's plan."""

    kind: Kind
    condition: str = ""
    """Empty before the first and after the last condition."""
    position: int = 0
    """Position of the condition in the participant's order, from 1; 0 outside conditions."""
    questionnaire: str = ""
    task: Task | None = None
    """Of a calibration."""
    block: int = 0
    """From 1; 0 outside blocks, as in training."""
    trial: int = 0
    """Number within its block, or within training, from 1."""
    target: str = ""
    seed: int = 0
    """Of the trial's first attempt, for simulations."""
    timeout_s: float = 0.0
    free: bool = False
    """Whether the trial continues after Target Hit."""

    @property
    def key(self) -> str:
        """Name within the participant's plan, as stored."""
        if self.is_trial:
            return f"{self.kind}/{self.position}/{self.block}/{self.trial}"
        words = [
            self.kind,
            self.questionnaire or self.task or "",
            str(self.position) if self.position else "",
        ]
        return "/".join(word for word in words if word)

    @property
    def is_trial(self) -> bool:
        """Whether it is a training or study trial."""
        return self.kind in ("training", "trial")


def attempt_seed(stage: Stage, attempt: int) -> int:
    """Return the seed of an attempt (from 1) at a trial; no two attempts have the same."""
    return stage.seed if attempt == 1 else hashed_integer(stage.seed, "attempt", attempt) % 2**31


def conditions_of(protocol: Protocol, slot: int) -> list[str]:
    """Return the conditions of the participant in a slot (from 0), in order."""
    return _met(protocol.study, _names(protocol)[0], slot)


def condition_title(protocol: Protocol, stage: Stage, reader: Literal["participant", "experimenter"]) -> str:
    """Return a stage's condition as shown to a reader: its title or, if blinded, its position."""
    blind = protocol.study.blind
    if not stage.condition:
        return ""
    if blind in ("everyone", reader):
        return f"condition {stage.position}" if stage.position else "training"
    return protocol.condition(stage.condition).title


def plan_of(protocol: Protocol, slot: int, *, is_first_draw: bool = False) -> list[Stage]:
    """Return all stages of the participant in a slot (from 0), in order.

    Args:
        protocol: The protocol.
        slot: The participant's place in the counterbalancing.
        is_first_draw: Whether the targets are those of the first draw, balanced over conditions or not, as in
            studies that 0.1 began.
    """
    order, trials = conditions_of(protocol, slot), protocol.trials
    conditions, names = _names(protocol)
    draw = 0 if is_first_draw else _best_draw(protocol.study, trials, conditions, names)
    targets = iter(_targets(protocol.study, trials, conditions, names, slot, draw))
    plan = [Stage("briefing"), Stage("consent"), *_questionnaires(protocol, "start")]
    plan += [
        Stage("calibration", task=task)
        for task in (protocol.calibration.tasks if protocol.calibration else ())
    ]
    plan += _training(
        protocol, slot, "study", (protocol.training and protocol.training.condition) or order[0], 0
    )
    for position, condition in enumerate(order, 1):
        if position > 1 and protocol.texts.break_text.strip():
            plan.append(Stage("break", position=position))
        plan += _training(protocol, slot, "condition", condition, position)
        for block in range(1, trials.blocks + 1):
            for trial in range(1, trials.repetitions + 1):
                plan.append(
                    Stage(
                        "trial",
                        condition,
                        position,
                        block=block,
                        trial=trial,
                        target=next(targets),
                        seed=_seed(protocol, slot, position, block, trial),
                        timeout_s=trials.timeout_s,
                    )
                )
        plan += _questionnaires(protocol, "condition", condition, position)
    return [*plan, *_questionnaires(protocol, "end"), Stage("thanks")]


def inseparable(pairs: Iterable[tuple[str, str]]) -> str:
    """Return how condition and target of trials are confounded; empty if both effects can be estimated.

    The rank of a linear model with both factors falls by one for each group of conditions with targets of
    their own, beyond the first.

    Args:
        pairs: Condition and target of each trial.
    """
    groups: list[tuple[set[str], set[str]]] = []
    for condition, target in sorted(set(pairs)):
        joined = [each for each in groups if condition in each[0] or target in each[1]]
        groups = [each for each in groups if each not in joined]
        conditions = {condition}.union(*(each[0] for each in joined))
        groups.append((conditions, {target}.union(*(each[1] for each in joined))))
    if len(groups) < 2:
        return ""
    return "; ".join(
        f"{', '.join(sorted(targets))} only under {', '.join(sorted(conditions))}"
        for conditions, targets in groups
    )


def _names(protocol: Protocol) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of conditions and targets."""
    return tuple(each.name for each in protocol.conditions), tuple(each.name for each in protocol.targets)


def _order(study: StudyTable, names: tuple[str, ...], slot: int) -> list[str]:
    if study.design == "between" and study.order == "fixed":
        return [*names[slot % len(names) :], *names[: slot % len(names)]]
    return order_of(names, slot, study.seed, study.order, "conditions")


def _met(study: StudyTable, names: tuple[str, ...], slot: int) -> list[str]:
    """Return the conditions that a participant meets."""
    order = _order(study, names, slot)
    return order if study.design == "within" else order[:1]


def _targets(
    study: StudyTable,
    trials: Trials,
    conditions: tuple[str, ...],
    names: tuple[str, ...],
    slot: int,
    draw: int,
) -> list[str]:
    count = len(_met(study, conditions, slot)) * trials.blocks * trials.repetitions
    group, place = "", slot
    if study.order == "balanced":
        group, place = ">".join(_order(study, conditions, slot)), round_of(len(conditions), slot)
    return targets_of(names, count, place, study.seed, trials.target_order, group, draw)


@lru_cache(maxsize=32)
def _best_draw(study: StudyTable, trials: Trials, conditions: tuple[str, ...], names: tuple[str, ...]) -> int:
    """Return the first draw whose targets are balanced over the conditions, or else nearest to it."""
    per_condition = trials.blocks * trials.repetitions
    draws = max(1, min(DRAWS, DRAWN_PLANS // max(1, study.participants)))

    def imbalance(draw: int) -> int:
        pairs: Counter[tuple[str, str]] = Counter()
        for slot in range(study.participants):
            targets = _targets(study, trials, conditions, names, slot, draw)
            for position, condition in enumerate(_met(study, conditions, slot)):
                first = position * per_condition
                pairs.update((target, condition) for target in targets[first : first + per_condition])
        counts = [[pairs[target, condition] for condition in conditions] for target in names]
        return sum(max(each) - min(each) for each in counts)

    best, least = 0, imbalance(0)
    for draw in range(1, draws):
        if least == 0 or trials.target_order == "fixed":
            break
        if (found := imbalance(draw)) < least:
            best, least = draw, found
    return best


def _questionnaires(protocol: Protocol, when: str, condition: str = "", position: int = 0) -> Iterator[Stage]:
    for table, questionnaire in protocol.questionnaires:
        if table.when == when:
            yield Stage("questionnaire", condition, position, questionnaire=questionnaire.name)


def _training(protocol: Protocol, slot: int, before: str, condition: str, position: int) -> Iterator[Stage]:
    training = protocol.training
    if training is None or training.before != before:
        return
    names = [target.name for target in protocol.targets]
    for trial in range(1, training.trials + 1):
        yield Stage(
            "training",
            condition,
            position,
            trial=trial,
            target=names[(trial - 1) % len(names)],
            seed=_seed(protocol, slot, position, 0, trial),
            timeout_s=training.timeout_s,
            free=training.free,
        )


def _seed(protocol: Protocol, slot: int, *trial: int) -> int:
    return hashed_integer(protocol.study.seed, "trial", slot, *trial) % 2**31
