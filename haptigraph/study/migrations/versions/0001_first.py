"""Create the first tables."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
__all__ = ["down_revision", "revision", "upgrade"]


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "studies",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("title", sa.Text(), nullable=False),
        sa.Column("simulated", sa.Integer(), nullable=False),
        sa.Column("protocol_sha256", sa.String(length=64), nullable=False),
        sa.Column("parts", sa.Text(), nullable=False),
        sa.Column("software", sa.String(length=40), nullable=False),
        sa.Column("frozen_utc", sa.String(length=40), nullable=False),
        sa.PrimaryKeyConstraint("study", name=op.f("pk_studies")),
    )
    op.create_table(
        "participants",
        sa.Column("study", sa.String(length=80), nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("slot", sa.Integer(), nullable=False),
        sa.Column("conditions", sa.Text(), nullable=False),
        sa.Column("enrolled_utc", sa.String(length=40), nullable=False),
        sa.Column("consented_utc", sa.String(length=40), nullable=True),
        sa.Column("withdrawn_utc", sa.String(length=40), nullable=True),
        sa.ForeignKeyConstraint(["study"], ["studies.study"], name=op.f("fk_participants_studies")),
        sa.PrimaryKeyConstraint("study", "participant", name=op.f("pk_participants")),
    )
    op.create_index(
        "one_in_each_slot",
        "participants",
        ["study", "slot"],
        unique=True,
        sqlite_where=sa.text("withdrawn_utc IS NULL"),
        postgresql_where=sa.text("withdrawn_utc IS NULL"),
    )

    op.create_table(
        "sessions",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("station", sa.String(length=80), nullable=False),
        sa.Column("opened_utc", sa.String(length=40), nullable=False),
        sa.Column("closed_utc", sa.String(length=40), nullable=True),
        sa.ForeignKeyConstraint(
            ["study", "participant"],
            ["participants.study", "participants.participant"],
            name=op.f("fk_sessions_participants"),
        ),
        sa.PrimaryKeyConstraint("study", "participant", "session", name=op.f("pk_sessions")),
    )
    op.create_index(
        "one_open_session",
        "sessions",
        ["study", "participant"],
        unique=True,
        sqlite_where=sa.text("closed_utc IS NULL"),
        postgresql_where=sa.text("closed_utc IS NULL"),
    )

    op.create_table(
        "answers",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("questionnaire", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("item", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), nullable=False),
        sa.Column("condition", sa.String(length=80), nullable=True),
        sa.Column("answer", sa.Text(), nullable=False),
        sa.Column("answered_utc", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(
            ["study", "participant", "session"],
            ["sessions.study", "sessions.participant", "sessions.session"],
            name=op.f("fk_answers_sessions"),
        ),
        sa.PrimaryKeyConstraint(
            "study", "participant", "questionnaire", "position", "item", name=op.f("pk_answers")
        ),
    )
    op.create_table(
        "events",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=20), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("at_utc", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(
            ["study", "participant", "session"],
            ["sessions.study", "sessions.participant", "sessions.session"],
            name=op.f("fk_events_sessions"),
        ),
        sa.PrimaryKeyConstraint("study", "participant", "number", name=op.f("pk_events")),
    )
    op.create_table(
        "stages",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("stage", sa.String(length=200), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), nullable=False),
        sa.Column("done_utc", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(
            ["study", "participant", "session"],
            ["sessions.study", "sessions.participant", "sessions.session"],
            name=op.f("fk_stages_sessions"),
        ),
        sa.PrimaryKeyConstraint("study", "participant", "stage", name=op.f("pk_stages")),
    )
    op.create_table(
        "trials",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("phase", sa.String(length=10), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("block", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("trial", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("attempt", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), nullable=False),
        sa.Column("condition", sa.String(length=80), nullable=False),
        sa.Column("target", sa.String(length=80), nullable=False),
        sa.Column("seed", sa.Integer(), nullable=False),
        sa.Column("started_utc", sa.String(length=40), nullable=False),
        sa.Column("ended_utc", sa.String(length=40), nullable=True),
        sa.Column("outcome", sa.String(length=10), nullable=True),
        sa.Column("void", sa.Text(), nullable=True),
        sa.Column("recording", sa.Text(), nullable=True),
        sa.Column("recording_sha256", sa.String(length=64), nullable=True),
        sa.Column("procedure_sha256", sa.String(length=64), nullable=False),
        sa.Column("software", sa.String(length=40), nullable=False),
        sa.Column("measures", sa.Text(), nullable=True),
        sa.CheckConstraint("outcome IN ('hit', 'timeout', 'aborted')", name=op.f("ck_trials_outcome")),
        sa.CheckConstraint("phase IN ('training', 'trial')", name=op.f("ck_trials_phase")),
        sa.CheckConstraint("(outcome IS NULL) = (ended_utc IS NULL)", name=op.f("ck_trials_ended")),
        sa.ForeignKeyConstraint(
            ["study", "participant", "session"],
            ["sessions.study", "sessions.participant", "sessions.session"],
            name=op.f("fk_trials_sessions"),
        ),
        sa.PrimaryKeyConstraint(
            "study", "participant", "phase", "position", "block", "trial", "attempt", name=op.f("pk_trials")
        ),
    )
    op.create_index(
        "one_open_trial",
        "trials",
        ["study", "participant"],
        unique=True,
        sqlite_where=sa.text("outcome IS NULL"),
        postgresql_where=sa.text("outcome IS NULL"),
    )
