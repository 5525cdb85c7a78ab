"""One study in a store: freezes its protocol, takes participants in, and says how far each is.

Turns a protocol and a store into participants with a place in the balancing. Pseudonyms only.
"""

import re
from typing import Any

from msgspec import Struct, json
from sqlalchemy import Connection, func, select, update

from haptigraph.errors import BadInput
from haptigraph.study.plan import conditions_of
from haptigraph.study.protocol import Protocol
from haptigraph.study.store import Row, Store, to_json
from haptigraph.study.tables import PARTICIPANTS, STUDIES
from haptigraph.version import __version__

__all__ = ["Study", "canonical", "refuse_names", "study_in"]

PSEUDONYM = re.compile(r"([A-Z]{1,4})-?([0-9]{1,4})")
PSEUDONYM_SAYS = "1 to 4 capital letters and 1 to 4 digits, for example P07"


class Study(Struct, frozen=True):
    """One study in a store."""

    protocol: Protocol
    store: Store
    simulated: bool = False
    """Whether its participants are simulated; a study has people or simulated ones, never both."""

    @property
    def name(self) -> str:
        """Its key in the store."""
        return self.protocol.study.name

    def check_frozen(self) -> str:
        """Compare the protocol with the one that the study's first participant began with, if there is one.

        Returns:
            When it was frozen, ISO 8601; empty if it is not yet.

        Raises:
            BadInput: If they differ, saying in what, since when it is frozen and what to do.
        """
        with self.store.begin() as connection:
            row = self.frozen(connection)
        return row["frozen_utc"] if row else ""

    def enrol(self, participant: str | None = None) -> str:
        """Take a participant in, at the lowest free place; the first one freezes the protocol.

        Args:
            participant: The pseudonym; None: the next free one of P01, P02, ...

        Returns:
            The pseudonym.

        Raises:
            BadInput: If it is no pseudonym or taken, the study is full, or the protocol was changed.
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
            held = {row.slot for row in taken if row.withdrawn_utc is None}
            most = self.protocol.study.participants
            slot = next((slot for slot in range(most) if slot not in held), None)
            if slot is None:
                raise BadInput(f"study {self.name} is full: it has its {most} participants")
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

    def withdraw(self, participant: str) -> None:
        """Note that a participant has left the study; what is recorded stays, the place becomes free.

        Raises:
            BadInput: If there is none of that pseudonym, or left before.
        """
        with self.store.begin() as connection:
            if self.participant(connection, participant)["withdrawn_utc"] is not None:
                raise BadInput(f"participant {participant} has left the study before")
            here = (PARTICIPANTS.c.study == self.name) & (PARTICIPANTS.c.participant == participant)
            connection.execute(update(PARTICIPANTS).where(here).values(withdrawn_utc=self.store.now_utc()))

    def participants(self) -> list[Row]:
        """Return all participants, as the store has them, in the order they were taken in."""
        return self.store.rows(
            select(PARTICIPANTS)
            .where(PARTICIPANTS.c.study == self.name)
            .order_by(PARTICIPANTS.c.enrolled_utc, PARTICIPANTS.c.participant)
        )

    def participant(self, connection: Connection, name: str) -> Row:
        """Return a participant.

        Raises:
            BadInput: If there is none of that pseudonym.
        """
        here = (PARTICIPANTS.c.study == self.name) & (PARTICIPANTS.c.participant == name)
        row = connection.execute(select(PARTICIPANTS).where(here)).mappings().first()
        if row is None:
            count = connection.scalar(
                select(func.count()).select_from(PARTICIPANTS).where(PARTICIPANTS.c.study == self.name)
            )
            raise BadInput(f"study {self.name} has no participant {name!r}; it has {count}")
        return row

    def frozen(self, connection: Connection) -> Row | None:
        """Return the study as frozen, None if it is not yet.

        Raises:
            BadInput: If the protocol differs from the frozen one.
        """
        row = connection.execute(select(STUDIES).where(STUDIES.c.study == self.name)).mappings().first()
        if row is None:
            return None
        if bool(row["simulated"]) != self.simulated:
            has = ("people", "simulated participants")
            problem = f"has {has[row['simulated']]}; {has[self.simulated]} need a study of another name"
            raise BadInput(problem, f"study {self.name}")
        before: dict[str, str] = json.decode(row["parts"])
        changed = _differing(before, self.protocol.parts)
        if changed:
            since = row["frozen_utc"][:16].replace("T", " ")
            raise BadInput(
                f"frozen since its first participant was taken in ({since} UTC), but "
                f"{changed[0]} is not what it was then; put it back (an export has it), or give the new "
                f"study another name",
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

    def _pseudonym(self, wanted: str | None, taken: list[str]) -> str:
        alike = {canonical(name): name for name in taken}
        if wanted is None:
            return next(name for n in range(1, 10_000) if canonical(name := f"P{n:02}") not in alike)
        refuse_names(wanted)
        other = alike.get(canonical(wanted))
        if other is not None:
            too_like = "" if other == wanted else f", and {wanted} would be taken for it"
            raise BadInput(f"study {self.name} has a participant {other} already{too_like}")
        return wanted


def study_in(store: Store, protocol: Protocol) -> Study:
    """Return a study with people or simulated participants, whichever the store has; people if none."""
    simulated = select(STUDIES.c.simulated).where(STUDIES.c.study == protocol.study.name)
    return Study(protocol, store, any(row["simulated"] for row in store.rows(simulated)))


def refuse_names(participant: str) -> None:
    """Refuse what is no pseudonym.

    Raises:
        BadInput: Saying what would be one.
    """
    if not PSEUDONYM.fullmatch(participant):
        raise BadInput(f"participants go by a pseudonym: {PSEUDONYM_SAYS}; found {participant[:40]!r}")


def canonical(pseudonym: str) -> tuple[str, int]:
    """Return the same for pseudonyms that would be taken for each other: P1 and P01."""
    found: Any = PSEUDONYM.fullmatch(pseudonym)
    return found[1], int(found[2])


def _differing(before: dict[str, str], now: dict[str, str]) -> list[str]:
    return sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
