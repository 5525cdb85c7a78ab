"""The plan of one participant: all stages in order, from protocol and slot.

Pure: the same protocol and slot give the same plan at every station and after every crash. The store holds
which stages are done.
"""

from collections.abc import Iterator
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.checksum import hashed_integer
from haptigraph.study.conditions import order_of, round_of, targets_of
from haptigraph.study.preparation.calibration import Task
from haptigraph.study.protocol import Protocol

__all__ = ["Kind", "Stage", "attempt_seed", "condition_title", "conditions_of", "plan_of"]

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
    order = _order(protocol, slot)
    return order if protocol.study.design == "within" else order[:1]


def condition_title(protocol: Protocol, stage: Stage, reader: Literal["participant", "experimenter"]) -> str:
    """Return a stage's condition as shown to a reader: its title or, if blinded, its position."""
    blind = protocol.study.blind
    if not stage.condition:
        return ""
    if blind in ("everyone", reader):
        return f"condition {stage.position}" if stage.position else "training"
    return protocol.condition(stage.condition).title


def plan_of(protocol: Protocol, slot: int) -> list[Stage]:
    """Return all stages of the participant in a slot (from 0), in order."""
    order, trials = conditions_of(protocol, slot), protocol.trials
    targets = iter(_targets(protocol, slot, len(order) * trials.blocks * trials.repetitions))
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


def _order(protocol: Protocol, slot: int) -> list[str]:
    names, study = [condition.name for condition in protocol.conditions], protocol.study
    if study.design == "between" and study.order == "fixed":
        return names[slot % len(names) :] + names[: slot % len(names)]
    return order_of(names, slot, study.seed, study.order, "conditions")


def _targets(protocol: Protocol, slot: int, count: int) -> list[str]:
    names, study = [target.name for target in protocol.targets], protocol.study
    group = ""
    if study.order == "balanced":
        group, slot = ">".join(_order(protocol, slot)), round_of(len(protocol.conditions), slot)
    return targets_of(names, count, slot, study.seed, protocol.trials.target_order, group)


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
