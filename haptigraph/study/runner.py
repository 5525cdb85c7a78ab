"""One participant's session at a station: returns the next stage, stores answers and trials durably.

It holds no state: the next stage is read from the store each time, so that after a crash any station resumes
exactly where the session stopped. Every write is one transaction; an action on any other stage is refused.
"""

import hashlib
from collections.abc import Mapping
from typing import Literal, TypeAlias

from msgspec.structs import replace
from sqlalchemy import Connection, delete, func, select, update

from haptigraph.config import Config, HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.study.data_dictionary import check_measures
from haptigraph.study.plan import attempt_seed
from haptigraph.study.preparation.strength import haptics_of, strength_of
from haptigraph.study.progress import Attempt, Next, read_progress, repeatable, trial_key
from haptigraph.study.recordings import fingerprint, prepare_path, recordings_folder
from haptigraph.study.roster import Study
from haptigraph.study.station import OpenSession, begin_session, end_session
from haptigraph.study.store import to_json
from haptigraph.study.tables import ANSWERS, CALIBRATION, EVENTS, PARTICIPANTS, TRIALS, is_erased
from haptigraph.version import __version__

__all__ = ["Measures", "Outcome", "Session", "open_session"]

Outcome: TypeAlias = Literal["hit", "timeout", "aborted"]
Measures: TypeAlias = Mapping[str, float | int | str]


class Session(OpenSession):
    """A participant's session at a station; created by `open_session`."""

    def done(self, key: str) -> None:
        """Complete a briefing, the consent, a break or the thanks, or submit a questionnaire.

        Args:
            key: `Stage.key` of the displayed stage, so that a double click does not skip the next stage.

        Raises:
            BadInput: If another stage comes next, or a required item is not answered.
        """
        with self.study.store.begin() as connection:
            stage, upcoming = self._expect(connection, key)
            if stage.is_trial:
                raise BadInput(f"{key} is a trial; begin and end it instead")
            if stage.kind == "calibration":
                raise BadInput(f"{key} ends with the response to its last stimulus")
            if stage.kind == "questionnaire":
                items = self.study.protocol.questionnaire(stage.questionnaire).items
                missing = [item.key for item in items if item.required and item.key not in upcoming.answers]
                if missing:
                    raise BadInput(f"{key}: no answer yet to {', '.join(missing)}")
            now_utc = self._complete(connection, key)
            if stage.kind == "consent":
                mine = self._mine(PARTICIPANTS)
                connection.execute(update(PARTICIPANTS).where(*mine).values(consented_utc=now_utc))

    def answer(self, key: str, item: str, answer: str) -> None:
        """Store an answer; it may be changed until the questionnaire is submitted.

        Args:
            key: `Stage.key` of the displayed questionnaire.
            item: Key of the item.
            answer: A valid answer to the item.

        Raises:
            BadInput: If another stage comes next, there is no such item, or the answer is invalid.
        """
        with self.study.store.begin() as connection:
            stage, upcoming = self._expect(connection, key)
            if stage.kind != "questionnaire":
                raise BadInput(f"{key} is not a questionnaire")
            answer = self.study.protocol.questionnaire(stage.questionnaire).item(item).checked(answer)
            given = {"answer": answer, "answered_utc": self.study.store.now_utc(), "session": self.number}
            row = {"questionnaire": stage.questionnaire, "position": stage.position, "item": item}
            if item in upcoming.answers:
                connection.execute(update(ANSWERS).where(*self._mine(ANSWERS, row)).values(given))
            else:
                row |= {**self._here, "condition": stage.condition or None, **given}
                connection.execute(ANSWERS.insert().values(row))

    def clear_answer(self, key: str, item: str) -> None:
        """Delete an answer before the questionnaire is submitted.

        Args:
            key: `Stage.key` of the displayed questionnaire.
            item: Key of the item.

        Raises:
            BadInput: If another stage comes next.
        """
        with self.study.store.begin() as connection:
            stage, _ = self._expect(connection, key)
            row = {"questionnaire": stage.questionnaire, "position": stage.position, "item": item}
            connection.execute(delete(ANSWERS).where(*self._mine(ANSWERS, row)))

    def respond(
        self, key: str, number: int, response: str, haptics: HapticsConfig, page_output: str = ""
    ) -> None:
        """Store the response to the stimulus that was played; the last one completes the stage.

        Args:
            key: `Stage.key` of the displayed task.
            number: Of the stimulus.
            response: One of its choices.
            haptics: Device and limits of the station.
            page_output: Where the participant's page played it too.

        Raises:
            BadInput: If another stage or stimulus comes next, or there is no such choice.
        """
        with self.study.store.begin() as connection:
            stage, _ = self._expect(connection, key)
            progress = read_progress(connection, self.study.name, self.participant)
            asking = self._asking(stage, progress, haptics)
            if asking is None:
                raise BadInput(f"{key} is not a calibration")
            row, is_last = asking.respond(number, response)
            row |= {"session": self.number, "page_output": page_output or None}
            row |= {**self._here, "at_utc": self.study.store.now_utc()}
            connection.execute(CALIBRATION.insert().values(row))
            if is_last:
                self._complete(connection, key)

    def skip_calibration(self, key: str, reason: str) -> None:
        """Go on without the rest of a calibration task, for example because the device is broken.

        Raises:
            BadInput: If another stage comes next, or no reason is given.
        """
        if not reason.strip():
            raise BadInput("a calibration is not skipped without a reason; give one")
        with self.study.store.begin() as connection:
            stage, _ = self._expect(connection, key)
            if stage.kind != "calibration":
                raise BadInput(f"{key} is not a calibration")
            self._complete(connection, key)
            self._insert_event(connection, "note", f"{key} skipped: {reason.strip()}")

    def begin_trial(self, key: str, *, records: bool = True) -> Next:
        """Begin the next trial.

        Args:
            key: Its `Stage.key`.
            records: Whether it is recorded, at the path that `config` returns.

        Raises:
            BadInput: If another stage comes next, or the trial has already begun.
        """
        with self.study.store.begin() as connection:
            stage, upcoming = self._expect(connection, key)
            if not stage.is_trial:
                raise BadInput(f"{key} is not a trial")
            if upcoming.running:
                raise BadInput(f"{key} has already begun (attempt {upcoming.attempt})")
            condition = self.study.protocol.condition(stage.condition)
            text = self.study.protocol.procedures[condition.procedure]
            row = {
                **self._here,
                **trial_key(stage),
                "attempt": upcoming.attempt,
                "session": self.number,
                "condition": stage.condition,
                "target": stage.target,
                "seed": attempt_seed(stage, upcoming.attempt),
                "started_utc": self.study.store.now_utc(),
                "recording": self._recording(upcoming) if records else None,
                "procedure_sha256": hashlib.sha256(text.encode()).hexdigest(),
                "software": __version__,
            }
            connection.execute(TRIALS.insert().values(row))
        return replace(upcoming, running=True)

    def end_trial(self, outcome: Outcome, *, void: str = "", measures: Measures | None = None) -> None:
        """End the running trial; its recording, if any, must be closed.

        Args:
            outcome: Whether the target was hit, time ran out, or the trial was aborted.
            void: Why the attempt does not count; for an aborted one the reason.
            measures: Values by the names of the data dictionary; None: the export computes them from the
                recording.

        Raises:
            BadInput: If no trial is running, a measure is unknown, or the recording is incomplete.
        """
        checked = check_measures(measures or {})
        ended = {
            "outcome": outcome,
            "void": void.strip() or ("aborted" if outcome == "aborted" else None),
            "ended_utc": self.study.store.now_utc(),
            "measures": to_json(checked) if checked else None,
        }
        recording = self._running().recording
        if recording:  # hashed before the transaction, for which other stations wait
            path = self.study.protocol.folder / recording
            ended["recording_sha256"] = fingerprint(path, must_be_whole=outcome != "aborted")
        with self.study.store.begin() as connection:
            self._require_open(connection)
            running = (*self._mine(TRIALS), TRIALS.c.outcome.is_(None))
            connection.execute(update(TRIALS).where(*running).values(ended))

    def repeat_trial(self, key: str, reason: str) -> None:
        """Schedule the preceding trial again; the previous attempt stays in the data but does not count.

        Args:
            key: Its `Stage.key`.
            reason: Why it is repeated.

        Raises:
            BadInput: If it is not the preceding stage, or no reason is given.
        """
        if not reason.strip():
            raise BadInput("a trial is not repeated without a reason; give one")
        with self.study.store.begin() as connection:
            progress = self._require_open(connection)
            previous = repeatable(self.plan, progress, self._next(progress))
            counted = progress.counted(previous) if previous is not None else None
            if previous is None or counted is None or previous.key != key:
                raise BadInput(f"participant {self.participant}: {key} does not lie right behind")
            row = self._mine(TRIALS, {**trial_key(previous), "attempt": counted.attempt})
            connection.execute(update(TRIALS).where(*row).values(void=reason.strip()))

    def note(self, text: str) -> None:
        """Store a note of the experimenter."""
        self._add_event("note", text)

    def answer_pulse(self, output: str, *, is_felt: bool) -> None:
        """Store whether the participant felt the test pulse of outputs, joined by " + "."""
        self._add_event("felt" if is_felt else "unfelt", output)

    def stop(self, reason: str) -> None:
        """End the participant's study early and for good."""
        self._add_event("stop", reason)

    def close(self) -> None:
        """Leave the station; the participant may resume elsewhere. A running trial is interrupted."""
        with self.study.store.begin() as connection:
            self._require_open(connection)
            end_session(connection, self.study, self.participant)

    def config(self, base: Config) -> Config:
        """Return the configuration of the next trial, and prepare the path of its recording.

        Build the loop with it before you begin the trial, so that a failure to open uses up no attempt.

        Args:
            base: The station's configuration: source, registration, device.

        Raises:
            BadInput: If the next stage is no trial, it has begun, or its recording is being written.
        """
        with self.study.store.begin() as connection:
            progress = read_progress(connection, self.study.name, self.participant)
        upcoming = self._next(progress)
        stage = upcoming.stage
        if stage is None or not stage.is_trial or upcoming.running:
            raise BadInput(f"participant {self.participant}: the next stage is not a trial yet to begin")
        protocol = self.study.protocol
        condition = protocol.condition(stage.condition)
        patterns = protocol.patterns[condition.procedure]
        measured = progress.responses.get(("threshold", base.haptics.device), ())
        strength = strength_of(protocol.calibration, patterns, measured, base.haptics)
        path = protocol.folder / self._recording(upcoming)
        prepare_path(path)
        seed = attempt_seed(stage, upcoming.attempt)
        name, output = f"{stage.key}/{upcoming.attempt}", base.trial.touch_output if condition.touch else ""
        return replace(
            base,
            source=replace(base.source, target_mm=protocol.target(stage.target).along_mm),
            haptics=haptics_of(condition.touch, condition.sham_duty, seed, strength, base.haptics),
            run=replace(base.run, procedure=protocol.procedure_path(condition)),
            recording=replace(base.recording, path=str(path)),
            trial=replace(base.trial, participant=self.participant, trial=name, touch_output=output),
        )

    def _running(self) -> Attempt:
        with self.study.store.begin() as connection:
            running = self._require_open(connection).running
        if running is None:
            raise BadInput(f"participant {self.participant}: no trial is running")
        return running

    def _recording(self, upcoming: Next) -> str:
        """Return the path of a recording in the study's folder; it does not reveal the condition."""
        key = upcoming.stage.key.replace("/", "-") if upcoming.stage else ""
        return f"{recordings_folder(self.participant)}/{key}-attempt{upcoming.attempt}.mcap"

    def _add_event(self, kind: str, text: str) -> None:
        if not text.strip():
            raise BadInput(f"a {kind} needs words; found none")
        with self.study.store.begin() as connection:
            self._require_open(connection)
            self._insert_event(connection, kind, text.strip())

    def _insert_event(self, connection: Connection, kind: str, text: str) -> None:
        count = connection.scalar(select(func.count()).select_from(EVENTS).where(*self._mine(EVENTS))) or 0
        row = {**self._here, "number": count + 1, "session": self.number, "kind": kind, "text": text}
        connection.execute(EVENTS.insert().values({**row, "at_utc": self.study.store.now_utc()}))


def open_session(study: Study, participant: str, station: str, *, take_over: bool = False) -> Session:
    """Open a participant's session at a station; mark a trial that was running as interrupted.

    Args:
        study: The study.
        participant: The pseudonym.
        station: The station's name.
        take_over: Whether to take over a participant from another station.

    Raises:
        BadInput: If the participant is unknown, erased or at another station, or the protocol was changed.
    """
    with study.store.begin() as connection:
        study.frozen(connection)
        row = study.participant(connection, participant)
        if is_erased(row):
            raise BadInput(f"participant {participant} has withdrawn; all data were erased")
        number = begin_session(connection, study, participant, station, take_over=take_over)
    return Session(study, participant, row["slot"], number)
