"""Simulated participants go through a study, several at once, each in a process.

Turns a study's folder, a seed and a count into a store that has them all. Who has been through stays; whoever
is missing is played. What comes out depends on the seed alone.
"""

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from multiprocessing import active_children, get_context

from msgspec import Struct
from sqlalchemy import select

from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.writer import Progress
from haptigraph.study.plan import Stage
from haptigraph.study.protocol import FILE, Protocol
from haptigraph.study.roster import Study
from haptigraph.study.simulated.actions import act_of, rehearse
from haptigraph.study.simulated.participant import draw_participant
from haptigraph.study.simulated.player import Cast, SessionTime, play, pseudonym
from haptigraph.study.standing import standings
from haptigraph.study.store import Store
from haptigraph.study.tables import EVENTS

__all__ = ["Played", "simulate"]


class Played(Struct):
    """What was played."""

    participants: int = 0
    trials: int = 0
    steered_s: float = 0.0
    """Simulated."""


def simulate(cast: Cast, count: int, *, workers: int = 1, progress: Progress | None = None) -> Played:
    """Lead simulated participants through a study; those who have been through before stay as they are.

    Args:
        cast: Who plays what.
        count: How many participants there shall be in all.
        workers: Processes at once; what comes out does not depend on it.
        progress: Told how many are through.

    Raises:
        BadInput: If the study takes fewer, has people, or was begun otherwise, or is being simulated.
    """
    elsewhere = "is being simulated by another program; wait for it, or end it"
    with not_being_written(cast.protocol().folder / FILE, elsewhere):
        missing, played = _take_in(cast, count), Played()
        report = progress or (lambda what, done, total: None)
        report("simulating participants", count - len(missing), count)
        for trials, steered_s in _played(cast, missing, workers):
            played = Played(played.participants + 1, played.trials + trials, played.steered_s + steered_s)
            report("simulating participants", count - len(missing) + played.participants, count)
    return played


def _played(cast: Cast, numbers: list[int], workers: int) -> Iterator[tuple[int, float]]:
    """Yield what each participant steered, as they come through."""
    if workers == 1 or len(numbers) < 2:
        yield from (play(cast, number) for number in numbers)
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(numbers)), context, _leave_ctrl_c) as pool:
        try:
            for future in as_completed([pool.submit(play, cast, number) for number in numbers]):
                yield future.result()
        except BrokenProcessPool:
            raise HaptigraphError("a process was killed; run the same again, it goes on from there") from None
        except BaseException:
            for process in active_children():
                process.terminate()
            raise


def _leave_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who started us ends us


def _take_in(cast: Cast, count: int) -> list[int]:
    """Take in who is not yet there; return the numbers of those who have not been through."""
    protocol, time = cast.protocol(), SessionTime(0)
    _check(protocol, count)
    with closing(Store(cast.store, time)) as store:
        study = Study(protocol, store, simulated=True)
        study.check_frozen()
        _check_notes(study, cast)
        there = {row["participant"] for row in study.participants()}
        for number in range(count):
            if pseudonym(number) not in there:
                time.now = SessionTime(number).now
                study.enrol(pseudonym(number))
        through = {
            each.participant for each in standings(study) if each.next.stage is None and not each.station
        }
    return [number for number in range(count) if pseudonym(number) not in through]


def _check(protocol: Protocol, count: int) -> None:
    most = protocol.study.participants
    if count > most:
        problem = (
            f"the protocol takes {most} participants, found {count} to simulate; raise study.participants"
        )
        raise BadInput(problem, protocol.folder)
    for condition in protocol.conditions:
        sample = Stage("trial", condition.name, target=protocol.targets[0].name, timeout_s=1.0)
        rehearse(act_of(protocol, sample), draw_participant(0, 0), 0).loop.close()


def _check_notes(study: Study, cast: Cast) -> None:
    """Refuse to go on with what was begun otherwise."""
    first = (EVENTS.c.study == study.name) & (EVENTS.c.number == 1)
    for row in study.store.rows(select(EVENTS.c.text).where(first)):
        if row["text"] != cast.says:
            problem = (
                f"was begun as {row['text']!r}, not as {cast.says!r}; go on as it was begun, or elsewhere"
            )
            raise BadInput(problem, f"study {study.name}")
