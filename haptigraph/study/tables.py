"""The tables of the store. Time stamps are ISO 8601 in UTC.

A change here requires a migration in `migrations/versions`; a test compares the two.
"""

from typing import Any

from sqlalchemy import (
    CheckConstraint,
    Column,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    MetaData,
    RowMapping,
    String,
    Table,
    Text,
    text,
)

__all__ = [
    "ANSWERS",
    "CALIBRATION",
    "EVENTS",
    "METADATA",
    "PARTICIPANTS",
    "SESSIONS",
    "STAGES",
    "STUDIES",
    "TRIALS",
    "is_erased",
]

METADATA = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(referred_table_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
    }
)


def _key(name: str, kind: type[Integer | Text] | String = Integer) -> Column[Any]:
    return Column(name, kind, primary_key=True, autoincrement=False)


def _of_session() -> ForeignKeyConstraint:
    return ForeignKeyConstraint(
        ["study", "participant", "session"], ["sessions.study", "sessions.participant", "sessions.session"]
    )


NAME, STAMP = String(80), String(40)

STUDIES = Table(
    "studies",
    METADATA,
    _key("study", NAME),
    Column("title", Text, nullable=False),
    Column("simulated", Integer, nullable=False),  # 1: by simulated participants
    Column("protocol_sha256", String(64), nullable=False),
    Column("parts", Text, nullable=False),  # JSON: text by name
    Column("software", String(40), nullable=False),
    Column("frozen_utc", STAMP, nullable=False),
)
"""Studies with at least one participant; their protocols are frozen."""

PARTICIPANTS = Table(
    "participants",
    METADATA,
    Column("study", NAME, ForeignKey("studies.study"), primary_key=True),
    _key("participant", NAME),
    Column("slot", Integer, nullable=False),  # place in the counterbalancing, from 0
    Column("conditions", Text, nullable=False),  # joined by ">"
    Column("enrolled_utc", STAMP, nullable=False),
    Column("consented_utc", STAMP),
    Column("withdrawn_utc", STAMP),
    Index(
        "one_in_each_slot",
        "study",
        "slot",
        unique=True,
        sqlite_where=text("withdrawn_utc IS NULL"),
        postgresql_where=text("withdrawn_utc IS NULL"),
    ),
)
"""Enrolled participants. After erasure only pseudonym, slot and the time of erasure remain."""

SESSIONS = Table(
    "sessions",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("session"),
    Column("station", NAME, nullable=False),
    Column("opened_utc", STAMP, nullable=False),
    Column("closed_utc", STAMP),
    ForeignKeyConstraint(["study", "participant"], ["participants.study", "participants.participant"]),
    Index(
        "one_open_session",
        "study",
        "participant",
        unique=True,
        sqlite_where=text("closed_utc IS NULL"),
        postgresql_where=text("closed_utc IS NULL"),
    ),
)
"""Uninterrupted periods of a participant at a station; after a crash a new one begins."""

STAGES = Table(
    "stages",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("stage", String(200)),
    Column("session", Integer, nullable=False),
    Column("done_utc", STAMP, nullable=False),
    _of_session(),
)
"""Completed stages other than trials."""

ANSWERS = Table(
    "answers",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("questionnaire", NAME),
    _key("position"),  # of the condition to which it refers; 0: one-off questionnaire
    _key("item", NAME),
    Column("session", Integer, nullable=False),
    Column("condition", NAME),
    Column("answer", Text, nullable=False),
    Column("answered_utc", STAMP, nullable=False),
    _of_session(),
)

CALIBRATION = Table(
    "calibration",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("task", String(20)),
    _key("device", Text),
    _key("number"),
    Column("session", Integer, nullable=False),
    Column("round", Integer, nullable=False),
    Column("pattern", NAME),  # empty: a stimulus of the threshold
    Column("amplitude", Double, nullable=False),  # 0: a catch trial
    Column("response", NAME, nullable=False),
    Column("correct", Integer, nullable=False),
    Column("page_output", Text),  # where the participant's page played it too
    Column("at_utc", STAMP, nullable=False),
    _of_session(),
    CheckConstraint("task IN ('threshold', 'patterns')", name="task"),
)
"""Stimuli of the calibration that were answered, one row each."""

TRIALS = Table(
    "trials",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("phase", String(10)),
    _key("position"),  # 0: before the first condition
    _key("block"),  # 0: training
    _key("trial"),
    _key("attempt"),
    Column("session", Integer, nullable=False),
    Column("condition", NAME, nullable=False),
    Column("target", NAME, nullable=False),
    Column("seed", Integer, nullable=False),
    Column("started_utc", STAMP, nullable=False),
    Column("ended_utc", STAMP),
    Column("outcome", String(10)),
    Column("void", Text),  # why it does not count; empty: it does
    Column("recording", Text),  # path relative to the study's folder
    Column("recording_sha256", String(64)),
    Column("procedure_sha256", String(64), nullable=False),
    Column("software", String(40), nullable=False),
    Column("measures", Text),  # JSON: number or text by name
    _of_session(),
    CheckConstraint("outcome IN ('hit', 'timeout', 'aborted')", name="outcome"),
    CheckConstraint("phase IN ('training', 'trial')", name="phase"),
    CheckConstraint("(outcome IS NULL) = (ended_utc IS NULL)", name="ended"),
    Index(
        "one_open_trial",
        "study",
        "participant",
        unique=True,
        sqlite_where=text("outcome IS NULL"),
        postgresql_where=text("outcome IS NULL"),
    ),
)
"""Trials that have begun, one row per attempt; `outcome` is empty while it is running."""

EVENTS = Table(
    "events",
    METADATA,
    _key("study", NAME),
    _key("participant", NAME),
    _key("number"),
    Column("session", Integer, nullable=False),
    Column("kind", String(20), nullable=False),
    Column("text", Text, nullable=False),
    Column("at_utc", STAMP, nullable=False),
    _of_session(),
)
"""The experimenter's notes and stops, in order."""


def is_erased(participant: RowMapping) -> bool:
    """Return whether a row of `PARTICIPANTS` contains only pseudonym and slot."""
    return bool(participant["enrolled_utc"] == participant["withdrawn_utc"])
