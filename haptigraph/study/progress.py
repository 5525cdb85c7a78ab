"""How far a participant is: what the store holds in, what comes next out.

`next_of` is pure: the same rows, plan and time give the same answer on every station and after every crash.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime

from msgspec import Struct, field
from sqlalchemy import ColumnElement, Connection, Table, select

from haptigraph.study.plan import Stage
from haptigraph.study.protocol import Protocol
from haptigraph.study.tables import ANSWERS, EVENTS, PARTICIPANTS, STAGES, TRIALS, is_erased

__all__ = [
    "Attempt",
    "Next",
    "Progress",
    "next_of",
    "of_participant",
    "read_progress",
    "repeatable",
    "trial_place",
]


class Attempt(Struct, frozen=True):
    """One attempt at a trial, as the store has it."""

    attempt: int
    outcome: str | None
    """None while it runs."""
    void: str | None
    """Why it does not count; None: it does."""
    recording: str | None


class Progress(Struct):
    """What the store holds of one participant."""

    consented_utc: str | None
    left: str
    """In words; empty: they have not."""
    done: set[str]
    """Keys of stages other than trials."""
    answers: dict[tuple[str, int], dict[str, str]] = field(default_factory=dict)
    """By questionnaire and position, then by item."""
    attempts: dict[tuple[str, int, int, int], list[Attempt]] = field(default_factory=dict)
    """By phase, position, block and trial; in order."""
    stopped: str = ""
    """Why the experimenter ended the session, if so."""

    def of(self, stage: Stage) -> list[Attempt]:
        """Return the attempts at a trial."""
        return self.attempts.get((stage.kind, stage.position, stage.block, stage.trial), [])

    @property
    def running(self) -> Attempt | None:
        """The attempt that runs, if any."""
        attempts = (attempt for each in self.attempts.values() for attempt in each)
        return next((attempt for attempt in attempts if attempt.outcome is None), None)

    def counted(self, stage: Stage) -> Attempt | None:
        """Return the attempt at a trial that counts, if there is one."""
        whole = [each for each in self.of(stage) if each.outcome is not None and each.void is None]
        return whole[-1] if whole else None

    def given_up(self, stage: Stage, most: int) -> bool:
        """Tell whether a trial was aborted so often that it is left."""
        attempts = self.of(stage)
        aborted = sum(attempt.outcome == "aborted" for attempt in attempts)
        return aborted >= most and attempts[-1].outcome == "aborted"


class Next(Struct, frozen=True):
    """What comes next."""

    stage: Stage | None
    """None: nothing more."""
    done: int
    """How many stages lie behind, of `of`."""
    of: int
    ended: str = ""
    """Why there is nothing more; empty while there is."""
    attempt: int = 0
    """Of the trial: the number of the one that runs, or of the one to begin."""
    running: bool = False
    """Whether the trial has begun."""
    answers: Mapping[str, str] = {}
    """Of the questionnaire, as far as given: by item."""


def of_participant(table: Table, study: str, participant: str) -> list[ColumnElement[bool]]:
    """Return the conditions for one participant's rows of a table."""
    return [table.c.study == study, table.c.participant == participant]


def trial_place(stage: Stage) -> dict[str, object]:
    """Return the columns that say which trial it is."""
    return {"phase": stage.kind, "position": stage.position, "block": stage.block, "trial": stage.trial}


def read_progress(connection: Connection, study: str, participant: str) -> Progress:
    """Read how far a participant is."""

    def mine(table: Table) -> list[ColumnElement[bool]]:
        return of_participant(table, study, participant)

    row = connection.execute(select(PARTICIPANTS).where(*mine(PARTICIPANTS))).mappings().one()
    done = connection.scalars(select(STAGES.c.stage).where(*mine(STAGES)))
    left = "the participant has left the study" if row["withdrawn_utc"] is not None else ""
    if is_erased(row):
        left = "the participant has withdrawn, everything was erased"
    progress = Progress(row["consented_utc"], left, set(done))
    for answer in connection.execute(select(ANSWERS).where(*mine(ANSWERS))):
        sheet = progress.answers.setdefault((answer.questionnaire, answer.position), {})
        sheet[answer.item] = answer.answer
    for trial in connection.execute(select(TRIALS).where(*mine(TRIALS)).order_by(TRIALS.c.attempt)):
        key = (trial.phase, trial.position, trial.block, trial.trial)
        attempt = Attempt(trial.attempt, trial.outcome, trial.void, trial.recording)
        progress.attempts.setdefault(key, []).append(attempt)
    stops = select(EVENTS.c.text).where(*mine(EVENTS), EVENTS.c.kind == "stop").order_by(EVENTS.c.number)
    progress.stopped = connection.scalar(stops) or ""
    return progress


def next_of(plan: Sequence[Stage], progress: Progress, protocol: Protocol, now: datetime) -> Next:
    """Return what comes next for a participant.

    Args:
        plan: All stages, in order.
        progress: What the store holds.
        protocol: For attempts and stopping rules.
        now: Time, for the stopping rule that needs it.
    """
    most = protocol.trials.attempts
    behind = next(
        (place for place, stage in enumerate(plan) if not _is_behind(stage, progress, most)), len(plan)
    )
    if progress.left:
        return Next(None, behind, len(plan), ended=progress.left)
    if behind == len(plan):
        return Next(None, behind, len(plan), ended="all is done")
    stage, attempts = plan[behind], progress.of(plan[behind])
    if attempts and attempts[-1].outcome is None:
        return Next(stage, behind, len(plan), attempt=attempts[-1].attempt, running=True)
    reason = progress.stopped or (
        _rule(plan[:behind], progress, protocol, now) if stage.kind in ("trial", "break") else ""
    )
    if reason:
        return Next(None, behind, len(plan), ended=f"stopped: {reason}")
    if stage.is_trial:
        return Next(stage, behind, len(plan), attempt=len(attempts) + 1)
    answers = progress.answers.get((stage.questionnaire, stage.position), {})
    return Next(stage, behind, len(plan), answers=answers)


def repeatable(plan: Sequence[Stage], progress: Progress, coming: Next) -> Stage | None:
    """Return the trial that may be done again: the one right behind, while nothing newer has begun."""
    before = plan[coming.done - 1] if coming.done else None
    if before is None or progress.counted(before) is None or coming.running or coming.answers:
        return None
    return before


def _is_behind(stage: Stage, progress: Progress, most: int) -> bool:
    if not stage.is_trial:
        return stage.key in progress.done
    return progress.counted(stage) is not None or progress.given_up(stage, most)


def _rule(behind: Sequence[Stage], progress: Progress, protocol: Protocol, now: datetime) -> str:
    """Return the stopping rule that forbids another trial, in words; empty if none does."""
    stop = protocol.stop
    counted = [progress.counted(stage) for stage in behind if stage.kind == "trial"]
    failed = sum(attempt is None for attempt in counted)
    in_a_row = 0
    for attempt in counted:
        in_a_row = in_a_row + 1 if attempt is not None and attempt.outcome == "timeout" else 0
    if stop.failed_trials and failed >= stop.failed_trials:
        return f"trials given up: {failed}"
    if stop.timeouts_in_a_row and in_a_row >= stop.timeouts_in_a_row:
        return f"{in_a_row} timeouts in a row"
    if stop.session_min and progress.consented_utc:
        passed_min = (now - datetime.fromisoformat(progress.consented_utc)).total_seconds() / 60
        if passed_min > stop.session_min:
            return f"{stop.session_min} minutes have passed"
    return ""
