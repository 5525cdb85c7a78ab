"""One study in a store: freezes its protocol and enrols participants under pseudonyms.

Assigns each participant a slot in the counterbalancing.
"""

import re
from collections.abc import Callable
from functools import partial
from typing import Any

from msgspec import Struct, json
from sqlalchemy import Connection, select, update

from haptigraph.errors import BadInput
from haptigraph.study.plan import Stage, conditions_of, plan_of
from haptigraph.study.protocol import Protocol
from haptigraph.study.store import Row, Store, to_json
from haptigraph.study.tables import PARTICIPANTS, STUDIES
from haptigraph.version import __version__

__all__ = ["Study", "canonical", "check_pseudonym", "study_in"]

FIRST_DRAW = "0.1."  # versions that did not balance targets over conditions by further draws
MAX_NAMES = 30  # in an error
PSEUDONYM = re.compile(r"([A-Z]{1,4})-?([0-9]{1,4})")


class Study(Struct, frozen=True):
    """One study in a store."""

    protocol: Protocol
    store: Store
    simulated: bool = False
    """Whether all participants are simulated; a study has people or simulated participants, never both."""

    @property
    def name(self) -> str:
        """Key in the store."""
        return self.protocol.study.name

    def check_frozen(self) -> Row | None:
        """Compare the protocol with the frozen one.

        Returns:
            The frozen study, or None if no participant is enrolled.

        Raises:
            BadInput: If they differ, with what changed, when the protocol was frozen, and what to do.
        """
        with self.store.begin() as connection:
            return self.frozen(connection)

    def enrol(self, participant: str | None = None) -> str:
        """Enrol a participant in the lowest free slot; the first one freezes the protocol.

        Args:
            participant: The pseudonym; None: the next free one of P01, P02, ...

        Returns:
            The pseudonym.

        Raises:
            BadInput: If the pseudonym is invalid or in use, the study is full, or the protocol was changed.
        """
        with self.store.begin() as connection:
            if self.frozen(connection) is None:
                self._freeze(connection)
            taken = connection.execute(
                select(PARTICIPANTS.c.participant, PARTICIPANTS.c.slot, PARTICIPANTS.c.withdrawn_utc).where(
                    PARTICIPANTS.c.study == self.name
                )
            ).all()
            participant = self._pseudonym(participant, [row.participant for row in taken])
            occupied = {row.slot for row in taken if row.withdrawn_utc is None}
            size = self.protocol.study.participants
            slot = next((slot for slot in range(size) if slot not in occupied), None)
            if slot is None:
                raise BadInput(f"study {self.name} is full: all {size} participants are enrolled")
            connection.execute(
                PARTICIPANTS.insert().values(
                    study=self.name,
                    participant=participant,
                    slot=slot,
                    conditions=">".join(conditions_of(self.protocol, slot)),
                    enrolled_utc=self.store.now_utc(),
                )
            )
        return participant

    def planner(self) -> Callable[[int], list[Stage]]:
        """Return the function from a slot (from 0) to all its stages; a study of 0.1 keeps its targets."""
        frozen = self.store.rows(select(STUDIES.c.software).where(STUDIES.c.study == self.name))
        is_first_draw = any(row["software"].startswith(FIRST_DRAW) for row in frozen)
        return partial(plan_of, self.protocol, is_first_draw=is_first_draw)

    def withdraw(self, participant: str) -> None:
        """Mark a participant as withdrawn; the data stay, the slot becomes free.

        Raises:
            BadInput: If the pseudonym is unknown, or the participant has already withdrawn.
        """
        with self.store.begin() as connection:
            if self.participant(connection, participant)["withdrawn_utc"] is not None:
                raise BadInput(f"participant {participant} has already left the study")
            here = (PARTICIPANTS.c.study == self.name) & (PARTICIPANTS.c.participant == participant)
            connection.execute(update(PARTICIPANTS).where(here).values(withdrawn_utc=self.store.now_utc()))

    def participants(self) -> list[Row]:
        """Return the rows of all participants, in the order of enrolment."""
        return self.store.rows(
            select(PARTICIPANTS)
            .where(PARTICIPANTS.c.study == self.name)
            .order_by(PARTICIPANTS.c.enrolled_utc, PARTICIPANTS.c.participant)
        )

    def participant(self, connection: Connection, name: str) -> Row:
        """Return a participant.

        Raises:
            BadInput: If the pseudonym is unknown.
        """
        here = (PARTICIPANTS.c.study == self.name) & (PARTICIPANTS.c.participant == name)
        row = connection.execute(select(PARTICIPANTS).where(here)).mappings().first()
        if row is None:
            all_of_study = select(PARTICIPANTS.c.participant).where(PARTICIPANTS.c.study == self.name)
            names = sorted(connection.scalars(all_of_study))
            more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
            text = f"{', '.join(names[:MAX_NAMES])}{more}" if names else "none yet"
            raise BadInput(f"study {self.name} has no participant {name!r}; it has {text}")
        return row

    def frozen(self, connection: Connection) -> Row | None:
        """Return the frozen study, or None if no participant is enrolled.

        Raises:
            BadInput: If the protocol differs from the frozen one.
        """
        row = connection.execute(select(STUDIES).where(STUDIES.c.study == self.name)).mappings().first()
        if row is None:
            return None
        if bool(row["simulated"]) != self.simulated:
            kinds = ("people", "simulated participants")
            problem = f"has {kinds[row['simulated']]}; {kinds[self.simulated]} need a study of another name"
            raise BadInput(problem, f"study {self.name}")
        changed = self.protocol.changed_parts(json.decode(row["parts"]))
        if changed:
            since = row["frozen_utc"][:16].replace("T", " ")
            raise BadInput(
                f"frozen since its first participant enrolled ({since} UTC), but {changed[0]} was changed "
                f"since; {_restoring(changed[0])}, or give the new study another name",
                f"study {self.name}",
            )
        return row

    def _freeze(self, connection: Connection) -> None:
        connection.execute(
            STUDIES.insert().values(
                study=self.name,
                title=self.protocol.study.title,
                simulated=int(self.simulated),
                protocol_sha256=self.protocol.sha256,
                parts=to_json(self.protocol.parts),
                software=__version__,
                frozen_utc=self.store.now_utc(),
            )
        )

    def _pseudonym(self, requested: str | None, taken: list[str]) -> str:
        existing = {canonical(name): name for name in taken}
        if requested is None:
            return next(name for n in range(1, 10_000) if canonical(name := f"P{n:02}") not in existing)
        check_pseudonym(requested)
        other = existing.get(canonical(requested))
        if other is not None:
            similar = "" if other == requested else f", which {requested} could be confused with"
            raise BadInput(f"study {self.name} already has a participant {other}{similar}")
        return requested


def study_in(store: Store, protocol: Protocol) -> Study:
    """Return a study of people or of simulated participants, as in the store; of people if it is new."""
    simulated = select(STUDIES.c.simulated).where(STUDIES.c.study == protocol.study.name)
    return Study(protocol, store, any(row["simulated"] for row in store.rows(simulated)))


def check_pseudonym(participant: str) -> None:
    """Refuse what is not a pseudonym, such as a name.

    Raises:
        BadInput: With what would be valid.
    """
    if not PSEUDONYM.fullmatch(participant):
        valid = "1 to 4 capital letters and 1 to 4 digits, for example P07"
        raise BadInput(f"participants go by a pseudonym: {valid}; found {participant[:40]!r}")


def canonical(pseudonym: str) -> tuple[str, int]:
    """Return the same value for pseudonyms that could be confused: P1 and P01."""
    found: Any = PSEUDONYM.fullmatch(pseudonym)
    return found[1], int(found[2])


def _restoring(part: str) -> str:
    """Return how to restore a part of a protocol; an update of haptigraph may change a shipped procedure."""
    kind, _, name = part.partition(" ")
    if kind != "procedure" or name.endswith(".toml"):
        return "restore it (an export contains it)"
    return f"save its text in study.json of an export as {name}.toml beside study.toml"
