"""The progress of a participant: from stored rows to the next stage.

`next_of` is pure: the same rows, plan and time give the same result at every station and after every crash.
"""

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime

from msgspec import Struct, field
from sqlalchemy import ColumnElement, Connection, Table, select

from haptigraph.study.plan import Stage
from haptigraph.study.preparation.calibration import Response, Task
from haptigraph.study.protocol import Protocol
from haptigraph.study.tables import ANSWERS, CALIBRATION, EVENTS, PARTICIPANTS, STAGES, TRIALS, is_erased

__all__ = [
    "Attempt",
    "Next",
    "Progress",
    "next_of",
    "of_participant",
    "read_progress",
    "repeatable",
    "trial_key",
]


class Attempt(Struct, frozen=True):
    """One stored attempt at a trial."""

    attempt: int
    outcome: str | None
    """None while it is running."""
    void: str | None
    """Why it does not count; None: it does."""
    recording: str | None


class Progress(Struct):
    """The stored data of one participant."""

    consented_utc: str | None
    withdrawn: str
    """A description; empty: the participant has not withdrawn."""
    done: set[str]
    """Keys of completed stages other than trials."""
    answers: dict[tuple[str, int], dict[str, str]] = field(default_factory=dict)
    """By questionnaire and position, then by item."""
    attempts: dict[tuple[str, int, int, int], list[Attempt]] = field(default_factory=dict)
    """By phase, position, block and trial; in order."""
    stopped: str = ""
    """Why the experimenter stopped the session; empty: not stopped."""
    responses: dict[tuple[Task, str], list[Response]] = field(default_factory=dict)
    """Of the calibration, by task and device; in order."""

    def of(self, stage: Stage) -> list[Attempt]:
        """Return the attempts at a trial."""
        return self.attempts.get((stage.kind, stage.position, stage.block, stage.trial), [])

    @property
    def running(self) -> Attempt | None:
        """The running attempt, if any."""
        attempts = (attempt for each in self.attempts.values() for attempt in each)
        return next((attempt for attempt in attempts if attempt.outcome is None), None)

    def counted(self, stage: Stage) -> Attempt | None:
        """Return the attempt at a trial that counts, if there is one."""
        counted = [each for each in self.of(stage) if each.outcome is not None and each.void is None]
        return counted[-1] if counted else None

    def has_failed(self, stage: Stage, max_attempts: int) -> bool:
        """Return whether a trial was aborted as often as the protocol allows; a repeat counts anew."""
        attempts = self.of(stage)
        repeated = [number for number, each in enumerate(attempts, 1) if each.outcome != "aborted"]
        return len(attempts) - max(repeated, default=0) >= max_attempts

    def is_completed(self, stage: Stage) -> bool:
        """Return whether a trial counts, another stage is done, or a questionnaire has answers."""
        if stage.is_trial:
            return self.counted(stage) is not None
        return stage.key in self.done or (stage.questionnaire, stage.position) in self.answers


class Next(Struct, frozen=True):
    """The next stage of a participant."""

    stage: Stage | None
    """None: the session has ended."""
    done: int
    """Number of completed stages, out of `of`."""
    of: int
    ended: str = ""
    """Why the session has ended; empty while it has not."""
    attempt: int = 0
    """Number of the running attempt at the trial, or of the one to begin."""
    running: bool = False
    """Whether the trial has begun."""
    answers: Mapping[str, str] = {}
    """Answers to the questionnaire so far, by item."""


def of_participant(table: Table, study: str, participant: str) -> list[ColumnElement[bool]]:
    """Return the SQL conditions that select one participant's rows of a table."""
    return [table.c.study == study, table.c.participant == participant]


def trial_key(stage: Stage) -> dict[str, object]:
    """Return the columns that identify a trial of a participant."""
    return {"phase": stage.kind, "position": stage.position, "block": stage.block, "trial": stage.trial}


def read_progress(connection: Connection, study: str, participant: str) -> Progress:
    """Read the progress of a participant."""

    def mine(table: Table) -> list[ColumnElement[bool]]:
        return of_participant(table, study, participant)

    row = connection.execute(select(PARTICIPANTS).where(*mine(PARTICIPANTS))).mappings().one()
    done = connection.scalars(select(STAGES.c.stage).where(*mine(STAGES)))
    withdrawn = "the participant has left the study" if row["withdrawn_utc"] is not None else ""
    if is_erased(row):
        withdrawn = "the participant has withdrawn; all data were erased"
    progress = Progress(row["consented_utc"], withdrawn, set(done))
    for answer in connection.execute(select(ANSWERS).where(*mine(ANSWERS))):
        sheet = progress.answers.setdefault((answer.questionnaire, answer.position), {})
        sheet[answer.item] = answer.answer
    for trial in connection.execute(select(TRIALS).where(*mine(TRIALS)).order_by(TRIALS.c.attempt)):
        key = (trial.phase, trial.position, trial.block, trial.trial)
        attempt = Attempt(trial.attempt, trial.outcome, trial.void, trial.recording)
        progress.attempts.setdefault(key, []).append(attempt)
    stimuli = select(CALIBRATION).where(*mine(CALIBRATION)).order_by(CALIBRATION.c.number)
    for stimulus in connection.execute(stimuli):
        response = Response(stimulus.pattern or "", stimulus.amplitude, stimulus.response)
        progress.responses.setdefault((stimulus.task, stimulus.device), []).append(response)
    stops = select(EVENTS.c.text).where(*mine(EVENTS), EVENTS.c.kind == "stop").order_by(EVENTS.c.number)
    progress.stopped = connection.scalar(stops) or ""
    return progress


def next_of(plan: Sequence[Stage], progress: Progress, protocol: Protocol, now: datetime) -> Next:
    """Return the next stage of a participant.

    Args:
        plan: All stages, in order.
        progress: The stored data.
        protocol: For attempts and stopping rules.
        now: The time, for the stopping rule on duration.
    """
    max_attempts = protocol.trials.attempts
    past = max((index for index, stage in enumerate(plan) if progress.is_completed(stage)), default=0)
    skipped = _training_after_criterion(plan, progress, protocol)
    done = next(
        (
            index
            for index, stage in enumerate(plan)
            if stage not in skipped and not _is_done(stage, progress, max_attempts, is_past=index < past)
        ),
        len(plan),
    )
    if progress.withdrawn:
        return Next(None, done, len(plan), ended=progress.withdrawn)
    if done == len(plan):
        return Next(None, done, len(plan), ended="all is done")
    stage, attempts = plan[done], progress.of(plan[done])
    if attempts and attempts[-1].outcome is None:
        return Next(stage, done, len(plan), attempt=attempts[-1].attempt, running=True)
    reason = progress.stopped or (
        _stopping_rule(plan[:done], progress, protocol, now) if stage.kind in ("trial", "break") else ""
    )
    if reason:
        return Next(None, done, len(plan), ended=f"stopped: {reason}")
    if stage.is_trial:
        return Next(stage, done, len(plan), attempt=len(attempts) + 1)
    answers = progress.answers.get((stage.questionnaire, stage.position), {})
    return Next(stage, done, len(plan), answers=answers)


def repeatable(plan: Sequence[Stage], progress: Progress, upcoming: Next) -> Stage | None:
    """Return the trial that may be repeated: the preceding stage, until the next one has begun."""
    previous = plan[upcoming.done - 1] if upcoming.done else None
    if previous is None or progress.counted(previous) is None or upcoming.running or upcoming.answers:
        return None
    return previous


def _is_done(stage: Stage, progress: Progress, max_attempts: int, *, is_past: bool) -> bool:
    if not stage.is_trial:
        return stage.key in progress.done
    if progress.counted(stage) is not None or progress.has_failed(stage, max_attempts):
        return True
    # Stores of version 0.1 go on: there, aborted attempts before a repeat counted too, and a trial was left.
    aborted = [each.outcome == "aborted" for each in progress.of(stage)]
    return is_past and sum(aborted) >= max_attempts and aborted[-1]


def _training_after_criterion(
    plan: Sequence[Stage], progress: Progress, protocol: Protocol
) -> Collection[Stage]:
    """Return the training trials that do not take place, because as many in a row as required were hits."""
    required = protocol.training.until_hits if protocol.training else 0
    skipped: set[Stage] = set()
    in_a_row: dict[int, int] = {}
    for stage in plan if required else ():
        if stage.kind != "training":
            continue
        hits, attempt = in_a_row.get(stage.position, 0), progress.counted(stage)
        if hits >= required and not progress.of(stage):
            skipped.add(stage)
        else:
            in_a_row[stage.position] = hits + 1 if attempt is not None and attempt.outcome == "hit" else 0
    return skipped


def _stopping_rule(done: Sequence[Stage], progress: Progress, protocol: Protocol, now: datetime) -> str:
    """Describe the stopping rule that forbids another trial; return "" if none applies."""
    stop = protocol.stop
    counted = [progress.counted(stage) for stage in done if stage.kind == "trial"]
    failed = sum(attempt is None for attempt in counted)
    in_a_row = 0
    for attempt in counted:
        in_a_row = in_a_row + 1 if attempt is not None and attempt.outcome == "timeout" else 0
    if stop.failed_trials and failed >= stop.failed_trials:
        return f"failed trials: {failed}"
    if stop.timeouts_in_a_row and in_a_row >= stop.timeouts_in_a_row:
        return f"{in_a_row} timeouts in a row"
    if stop.session_min and progress.consented_utc:
        passed_min = (now - datetime.fromisoformat(progress.consented_utc)).total_seconds() / 60
        if passed_min > stop.session_min:
            return f"{stop.session_min} minutes have passed"
    return ""
