"""One participant at one station: says what comes next, takes what happened, and keeps all of it at once.

Nothing is remembered here: what comes next is read from the store each time, so that after a crash this or
another station goes on exactly where it stopped. Every write is one transaction; what does not come next is
refused.
"""

import hashlib
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal, TypeAlias

from msgspec.structs import replace
from sqlalchemy import Connection, delete, func, select, update

from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.study.data_dictionary import check_measures
from haptigraph.study.plan import Stage, plan_of
from haptigraph.study.progress import (
    Attempt,
    Next,
    Progress,
    next_of,
    of_participant,
    read_progress,
    repeatable,
    trial_place,
)
from haptigraph.study.recordings import fingerprint, make_room, place_of
from haptigraph.study.roster import Study
from haptigraph.study.station import arrive, leave, open_row
from haptigraph.study.store import to_json
from haptigraph.study.tables import ANSWERS, EVENTS, PARTICIPANTS, STAGES, TRIALS, is_erased
from haptigraph.version import __version__

__all__ = ["Measures", "Outcome", "Session", "open_session"]

Outcome: TypeAlias = Literal["hit", "timeout", "aborted"]
Measures: TypeAlias = Mapping[str, float | int | str]


class Session:
    """A participant at a station; made by `open_session`.

    Args:
        study: The study.
        participant: The pseudonym.
        slot: The participant's place in the balancing.
        number: Of the session.
    """

    def __init__(self, study: Study, participant: str, slot: int, number: int) -> None:
        self.study, self.participant, self.number = study, participant, number
        self.plan = plan_of(study.protocol, slot)
        self._here = {"study": study.name, "participant": participant}

    def next(self) -> Next:
        """Return what comes next."""
        with self.study.store.begin() as connection:
            return self._next(read_progress(connection, self.study.name, self.participant))

    def done(self, key: str) -> None:
        """Note that a briefing, the consent, a break or the thanks is over, or a questionnaire is handed in.

        Args:
            key: `Stage.key` of the stage on the screen, so that a second click does not skip the next stage.

        Raises:
            BadInput: If another stage comes next, or a required item is not answered.
        """
        with self.study.store.begin() as connection:
            stage, coming = self._expect(connection, key)
            if stage.is_trial:
                raise BadInput(f"{key} is a trial; it is begun and ended")
            if stage.kind == "questionnaire":
                sheet = self.study.protocol.questionnaire(stage.questionnaire)
                missing = [i.key for i in sheet.items if i.required and i.key not in coming.answers]
                if missing:
                    raise BadInput(f"{key}: no answer yet to {', '.join(missing)}")
            now_utc = self.study.store.now_utc()
            row = {**self._here, "stage": key, "session": self.number, "done_utc": now_utc}
            connection.execute(STAGES.insert().values(row))
            if stage.kind == "consent":
                mine = self._mine(PARTICIPANTS)
                connection.execute(update(PARTICIPANTS).where(*mine).values(consented_utc=now_utc))

    def answer(self, key: str, item: str, answer: str) -> None:
        """Keep an answer; it may be changed until the questionnaire is handed in.

        Args:
            key: `Stage.key` of the questionnaire on the screen.
            item: Key of the item.
            answer: As the item takes it.

        Raises:
            BadInput: If another stage comes next, there is no such item, or it does not take the answer.
        """
        with self.study.store.begin() as connection:
            stage, coming = self._expect(connection, key)
            if stage.kind != "questionnaire":
                raise BadInput(f"{key} is no questionnaire")
            answer = self.study.protocol.questionnaire(stage.questionnaire).item(item).checked(answer)
            given = {"answer": answer, "answered_utc": self.study.store.now_utc(), "session": self.number}
            place = {"questionnaire": stage.questionnaire, "position": stage.position, "item": item}
            if item in coming.answers:
                connection.execute(update(ANSWERS).where(*self._mine(ANSWERS, place)).values(given))
            else:
                row = {**self._here, **place, "condition": stage.condition or None, **given}
                connection.execute(ANSWERS.insert().values(row))

    def take_back(self, key: str, item: str) -> None:
        """Forget an answer, as if it had not been given; until the questionnaire is handed in.

        Args:
            key: `Stage.key` of the questionnaire on the screen.
            item: Key of the item.

        Raises:
            BadInput: If another stage comes next.
        """
        with self.study.store.begin() as connection:
            stage, _ = self._expect(connection, key)
            place = {"questionnaire": stage.questionnaire, "position": stage.position, "item": item}
            connection.execute(delete(ANSWERS).where(*self._mine(ANSWERS, place)))

    def begin_trial(self, key: str, *, records: bool = True) -> Next:
        """Begin the trial that comes next.

        Args:
            key: Its `Stage.key`.
            records: Whether it will be recorded, where `config` says.

        Raises:
            BadInput: If another stage comes next, or it has begun before.
        """
        with self.study.store.begin() as connection:
            stage, coming = self._expect(connection, key)
            if not stage.is_trial:
                raise BadInput(f"{key} is no trial")
            if coming.running:
                raise BadInput(f"{key} has begun already (attempt {coming.attempt})")
            condition = self.study.protocol.condition(stage.condition)
            text = self.study.protocol.procedures[condition.procedure]
            row = {
                **self._here,
                **trial_place(stage),
                "attempt": coming.attempt,
                "session": self.number,
                "condition": stage.condition,
                "target": stage.target,
                "seed": stage.seed,
                "started_utc": self.study.store.now_utc(),
                "recording": self._recording(coming) if records else None,
                "procedure_sha256": hashlib.sha256(text.encode()).hexdigest(),
                "software": __version__,
            }
            connection.execute(TRIALS.insert().values(row))
        return replace(coming, running=True)

    def end_trial(self, outcome: Outcome, *, void: str = "", measures: Measures | None = None) -> None:
        """End the trial that runs; its recording, if any, must be closed.

        Args:
            outcome: Whether the target was hit, was not, or the trial was given up.
            void: Why it does not count; for an aborted one the reason.
            measures: Of the trial, by name as in the data dictionary; None: left to the export, which takes
                them from the recording.

        Raises:
            BadInput: If none runs, a measure is not known, or the recording is not whole.
        """
        ended = {
            "outcome": outcome,
            "void": void.strip() or ("aborted" if outcome == "aborted" else None),
            "ended_utc": self.study.store.now_utc(),
            "measures": to_json(kept) if (kept := check_measures(measures or {})) else None,
        }
        recording = self._running().recording
        if recording:  # read before the transaction: other stations would wait
            path = self.study.protocol.folder / recording
            ended["recording_sha256"] = fingerprint(path, must_be_whole=outcome != "aborted")
        with self.study.store.begin() as connection:
            self._fenced(connection)
            running = (*self._mine(TRIALS), TRIALS.c.outcome.is_(None))
            connection.execute(update(TRIALS).where(*running).values(ended))

    def repeat_trial(self, key: str, reason: str) -> None:
        """Let the trial right behind be done again; what was done stays in the data, but does not count.

        Args:
            key: Its `Stage.key`.
            reason: In words.

        Raises:
            BadInput: If it does not lie right behind, or no reason is given.
        """
        if not reason.strip():
            raise BadInput("a trial is not repeated without a reason; give one")
        with self.study.store.begin() as connection:
            progress = self._fenced(connection)
            coming = self._next(progress)
            before = repeatable(self.plan, progress, coming)
            counted = progress.counted(before) if before is not None else None
            if before is None or counted is None or before.key != key:
                raise BadInput(f"participant {self.participant}: {key} does not lie right behind")
            row = self._mine(TRIALS, {**trial_place(before), "attempt": counted.attempt})
            connection.execute(update(TRIALS).where(*row).values(void=reason.strip()))

    def note(self, text: str) -> None:
        """Keep a note of the experimenter."""
        self._add_event("note", text)

    def stop(self, reason: str) -> None:
        """End the participant's session for good, before its time."""
        self._add_event("stop", reason)

    def close(self) -> None:
        """Leave the station; the participant may go on elsewhere, a trial that runs is cut off."""
        with self.study.store.begin() as connection:
            self._fenced(connection)
            leave(connection, self.study, self.participant)

    def config(self, base: Config) -> Config:
        """Return the configuration of the trial that comes next, and make room for its recording.

        Build the loop with it, then begin the trial: what fails to open has then cost no attempt.

        Args:
            base: The station's own: source, registration, device.

        Raises:
            BadInput: If no trial comes next, it has begun, or its recording is being written.
        """
        coming = self.next()
        stage = coming.stage
        if stage is None or not stage.is_trial or coming.running:
            raise BadInput(f"participant {self.participant}: no trial comes next that has not begun")
        protocol = self.study.protocol
        condition = protocol.condition(stage.condition)
        path = protocol.folder / self._recording(coming)
        make_room(path)
        return replace(
            base,
            source=replace(base.source, target_mm=protocol.target(stage.target).along_mm),
            haptics=base.haptics if condition.touch else replace(base.haptics, max_amplitude=0.0),
            run=replace(base.run, procedure=protocol.procedure_path(condition)),
            recording=replace(base.recording, path=str(path)),
            trial=replace(base.trial, participant=self.participant, trial=f"{stage.key}/{coming.attempt}"),
        )

    def _running(self) -> Attempt:
        with self.study.store.begin() as connection:
            running = self._fenced(connection).running
        if running is None:
            raise BadInput(f"participant {self.participant}: no trial is running")
        return running

    def _recording(self, coming: Next) -> str:
        """Return where a trial is recorded, from the study's folder; it does not tell the condition."""
        key = coming.stage.key.replace("/", "-") if coming.stage else ""
        return f"{place_of(self.participant)}/{key}-attempt{coming.attempt}.mcap"

    def _next(self, progress: Progress) -> Next:
        now = datetime.fromisoformat(self.study.store.now_utc())
        return next_of(self.plan, progress, self.study.protocol, now)

    def _expect(self, connection: Connection, key: str) -> tuple[Stage, Next]:
        coming = self._next(self._fenced(connection))
        if coming.stage is None or coming.stage.key != key:
            what = coming.stage.key if coming.stage else f"nothing more ({coming.ended})"
            raise BadInput(f"participant {self.participant}: {key} does not come next, but {what}")
        return coming.stage, coming

    def _fenced(self, connection: Connection) -> Progress:
        """Return how far the participant is, if still here."""
        open_ = open_row(connection, self.study, self.participant)
        if open_ is None or open_.session != self.number:
            where = f"at {open_.station} now" if open_ else "at no station now"
            raise BadInput(f"participant {self.participant} is {where}; open the session again")
        return read_progress(connection, self.study.name, self.participant)

    def _mine(self, table: Any, place: Mapping[str, object] | None = None) -> list[Any]:
        mine = of_participant(table, self.study.name, self.participant)
        return [*mine, *(table.c[name] == value for name, value in (place or {}).items())]

    def _add_event(self, kind: str, text: str) -> None:
        if not text.strip():
            raise BadInput(f"a {kind} needs words; found none")
        with self.study.store.begin() as connection:
            self._fenced(connection)
            count = (
                connection.scalar(select(func.count()).select_from(EVENTS).where(*self._mine(EVENTS))) or 0
            )
            row = {
                **self._here,
                "number": count + 1,
                "session": self.number,
                "kind": kind,
                "text": text.strip(),
            }
            connection.execute(EVENTS.insert().values({**row, "at_utc": self.study.store.now_utc()}))


def open_session(study: Study, participant: str, station: str, *, take_over: bool = False) -> Session:
    """Bring a participant to a station; a trial that was cut off before is noted as interrupted.

    Args:
        study: The study.
        participant: The pseudonym.
        station: The station's name.
        take_over: Whether to take a participant who is at another station.

    Raises:
        BadInput: If there is no such participant, the protocol was changed, or another station has the
            participant, or who was one is erased.
    """
    with study.store.begin() as connection:
        study.frozen(connection)
        row = study.participant(connection, participant)
        if is_erased(row):
            raise BadInput(f"participant {participant} has withdrawn, and everything was erased")
        number = arrive(connection, study, participant, station, take_over=take_over)
    return Session(study, participant, row["slot"], number)
