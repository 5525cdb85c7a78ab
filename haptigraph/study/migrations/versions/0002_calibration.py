"""Create the table of the calibration."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
__all__ = ["down_revision", "revision", "upgrade"]


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "calibration",
        sa.Column("study", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("participant", sa.String(length=80), autoincrement=False, nullable=False),
        sa.Column("task", sa.String(length=20), autoincrement=False, nullable=False),
        sa.Column("device", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("session", sa.Integer(), nullable=False),
        sa.Column("round", sa.Integer(), nullable=False),
        sa.Column("pattern", sa.String(length=80), nullable=True),
        sa.Column("amplitude", sa.Double(), nullable=False),
        sa.Column("response", sa.String(length=80), nullable=False),
        sa.Column("correct", sa.Integer(), nullable=False),
        sa.Column("page_output", sa.Text(), nullable=True),
        sa.Column("at_utc", sa.String(length=40), nullable=False),
        sa.CheckConstraint("task IN ('threshold', 'patterns')", name=op.f("ck_calibration_task")),
        sa.ForeignKeyConstraint(
            ["study", "participant", "session"],
            ["sessions.study", "sessions.participant", "sessions.session"],
            name=op.f("fk_calibration_sessions"),
        ),
        sa.PrimaryKeyConstraint(
            "study", "participant", "task", "device", "number", name=op.f("pk_calibration")
        ),
    )
