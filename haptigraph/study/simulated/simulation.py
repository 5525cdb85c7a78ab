"""Simulate a study with several participants in parallel processes.

Participants who are complete stay; the others are simulated. The results depend on the seed only, not on the
number of processes.
"""

from collections.abc import Iterator
from contextlib import closing
from functools import partial

from msgspec import Struct
from sqlalchemy import select

from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.writer import Progress
from haptigraph.spreading.spread import spread
from haptigraph.spreading.tasks import Killed
from haptigraph.study.plan import Stage
from haptigraph.study.protocol import FILE, Protocol
from haptigraph.study.roster import Study
from haptigraph.study.simulated.actions import rehearse, trial_spec
from haptigraph.study.simulated.participant import draw_participant
from haptigraph.study.simulated.player import SessionClock, SimulationSpec, pseudonym, simulate_participant
from haptigraph.study.status import participant_statuses
from haptigraph.study.store import Store
from haptigraph.study.tables import EVENTS

__all__ = ["Simulated", "simulate"]


class Simulated(Struct):
    """What was simulated."""

    participants: int = 0
    trials: int = 0
    steered_s: float = 0.0
    """Simulated time."""


def simulate(
    spec: SimulationSpec, count: int, *, workers: int = 1, progress: Progress | None = None
) -> Simulated:
    """Simulate the participants of a study who are not complete yet.

    Args:
        spec: What is simulated.
        count: The total number of participants.
        workers: Number of parallel processes; the results do not depend on it.
        progress: Called with the number of complete participants.

    Raises:
        BadInput: If the protocol allows fewer, or the study has people, was simulated with other settings, or
            is being simulated.
        HaptigraphError: If a participant repeatedly killed the worker.
    """
    problem = "is being simulated by another program; wait for it, or end it"
    with not_being_written(spec.protocol().folder / FILE, problem):
        missing, done = _enrol(spec, count), Simulated()
        report = progress or (lambda what, done, total: None)
        report("simulating participants", count - len(missing), count)
        for trials, steered_s in _simulated(spec, missing, workers):
            done = Simulated(done.participants + 1, done.trials + trials, done.steered_s + steered_s)
            report("simulating participants", count - len(missing) + done.participants, count)
    return done


def _simulated(spec: SimulationSpec, numbers: list[int], workers: int) -> Iterator[tuple[int, float]]:
    """Yield number and duration of each participant's trials, in the order of completion."""
    if workers == 1 or len(numbers) < 2:
        yield from (simulate_participant(spec, number) for number in numbers)
        return
    for number, done in spread(
        partial(simulate_participant, spec), numbers, workers=min(workers, len(numbers))
    ):
        if isinstance(done, Killed):
            raise HaptigraphError(f"participant {pseudonym(number)}: {done.problem}")
        yield done


def _enrol(spec: SimulationSpec, count: int) -> list[int]:
    """Enrol missing participants; return the numbers of those who are not complete."""
    protocol, clock = spec.protocol(), SessionClock(0)
    _check(protocol, count)
    with closing(Store(spec.store, clock)) as store:
        study = Study(protocol, store, simulated=True)
        study.check_frozen()
        _check_notes(study, spec)
        enrolled = {row["participant"] for row in study.participants()}
        for number in range(count):
            if pseudonym(number) not in enrolled:
                clock.now = SessionClock(number).now
                study.enrol(pseudonym(number))
        complete = {
            each.participant
            for each in participant_statuses(study)
            if each.next.stage is None and not each.station
        }
    return [number for number in range(count) if pseudonym(number) not in complete]


def _check(protocol: Protocol, count: int) -> None:
    size = protocol.study.participants
    if count > size:
        problem = f"cannot simulate {count} of {size} participants; raise study.participants"
        raise BadInput(problem, protocol.folder)
    for condition in protocol.conditions:
        sample = Stage("trial", condition.name, target=protocol.targets[0].name, timeout_s=1.0)
        rehearse(trial_spec(protocol, sample), draw_participant(0, 0), 0).loop.close()


def _check_notes(study: Study, spec: SimulationSpec) -> None:
    """Refuse to continue a simulation that was started with other settings."""
    first = (EVENTS.c.study == study.name) & (EVENTS.c.number == 1)
    for row in study.store.rows(select(EVENTS.c.text).where(first)):
        if row["text"] not in spec.notes:
            problem = f"was started as {row['text']!r}, not as {spec.notes[0]!r}; continue it with the former"
            raise BadInput(f"{problem}, or simulate a copy", f"study {study.name}")
