"""Alembic's environment: migrate over the connection of the store, within its transaction."""

from alembic import context

from haptigraph.study.tables import METADATA

__all__: list[str] = []

context.configure(
    connection=context.config.attributes["connection"], target_metadata=METADATA, render_as_batch=True
)
context.run_migrations()
