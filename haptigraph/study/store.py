"""The store of studies: SQLite by default, PostgreSQL by URL; every write is durable when its call returns.

Provides transactions on the tables of `tables`. Needs the extra `study`.
"""

import json
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from haptigraph.errors import BadInput, MissingExtra, StoreFailed

try:
    import sqlalchemy
    from alembic import command
    from alembic.config import Config as AlembicConfig
    from alembic.util.exc import CommandError
    from sqlalchemy import Connection, Engine, RowMapping, Select, event, func, select
    from sqlalchemy.exc import ArgumentError, DBAPIError

    from haptigraph.study.tables import METADATA
except ModuleNotFoundError:
    raise MissingExtra("the store of a study", "study") from None

__all__ = ["Row", "Store", "to_json", "utc_now"]

Row: TypeAlias = RowMapping
BUSY_S = 30
RETRY_S = 0.01
LOCK = 7_203_945_118  # arbitrary; the same at all stations


def utc_now() -> datetime:
    """Return the time of this machine's clock."""
    return datetime.now(UTC)


class Store:
    """One database of studies, created or migrated when it is opened.

    Args:
        where: The path of an SQLite file, or a URL (postgresql://user:password@host/database).
        now: Returns the time.

    Raises:
        BadInput: If it cannot be opened, is not a store, or was created by a newer version.
        MissingExtra: If the driver for the URL is not installed.
    """

    def __init__(self, where: str | Path, now: Callable[[], datetime] = utc_now) -> None:
        self._engine, self.name = _engine(str(where))
        self._now = now
        try:
            with self.begin() as connection:
                _migrate(connection, self.name)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections to the database."""
        self._engine.dispose()

    def now_utc(self) -> str:
        """Return the time in the stored form."""
        return self._now().astimezone(UTC).isoformat(timespec="microseconds")

    @contextmanager
    def begin(self) -> Iterator[Connection]:
        """Open a transaction; it is durable when the context ends.

        Raises:
            StoreFailed: If the database reports an error.
        """
        try:
            with self._engine.begin() as connection:
                yield connection
        except DBAPIError as error:
            raise _failed(error.orig, self.name) from error

    def rows(self, query: "Select[Any]") -> list[Row]:
        """Return the rows of a query."""
        with self.begin() as connection:
            return list(connection.execute(query).mappings())

    def purge(self) -> None:
        """Rewrite the database, so that its files contain no byte of deleted data.

        Raises:
            StoreFailed: If the database reports an error, for example because it is in use.
        """
        raw = self._engine.raw_connection()
        try:
            database: Any = raw.driver_connection
            if self._engine.dialect.name == "sqlite":
                database.execute("VACUUM")
                busy = database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
                if busy:
                    raise StoreFailed("another program is reading it; end that first", self.name)
            else:
                database.autocommit = True
                database.execute(f"VACUUM FULL {', '.join(METADATA.tables)}")
        except self._engine.dialect.loaded_dbapi.Error as error:
            raise _failed(error, self.name) from error
        finally:
            raw.invalidate()  # its settings differ from those of the pool


def _failed(reason: object, name: str) -> StoreFailed:
    return StoreFailed(f"the database reported an error ({' '.join(str(reason).split())})", name)


def _engine(where: str) -> tuple[Engine, str]:
    """Return the engine, and the store's name without the password."""
    try:
        url = sqlalchemy.make_url(where if "://" in where else f"sqlite:///{Path(where).absolute()}")
    except (ArgumentError, ValueError):
        url = None
    if url is None or url.get_backend_name() not in ("sqlite", "postgresql"):
        problem = f"found {where!r}; expected a file path or postgresql://USER:PASSWORD@HOST/DATABASE"
        raise BadInput(problem, "store")
    if url.drivername == "sqlite":
        name = url.database or ""
        _check_sqlite(Path(name))
        engine = sqlalchemy.create_engine(url, connect_args={"timeout": BUSY_S})
        event.listen(engine, "connect", _on_connect)
    else:
        name = url.render_as_string(hide_password=True)
        try:
            engine = sqlalchemy.create_engine(url.set(drivername="postgresql+psycopg"))
        except ModuleNotFoundError:
            raise MissingExtra("a store on PostgreSQL", "postgresql") from None
    event.listen(engine, "begin", _on_begin)
    return engine, name


def _check_sqlite(path: Path) -> None:
    if not path.parent.is_dir():
        raise BadInput("cannot be written; its folder does not exist", path)
    if path.is_dir():
        raise BadInput("is a folder; expected the store's file", path)


def _on_connect(raw: Any, _: Any) -> None:
    """Make commits survive a power failure (WAL and FULL); disable the driver's implicit transactions."""
    raw.isolation_level = None
    _write_ahead(raw, time.monotonic() + BUSY_S)
    for pragma in ("synchronous=FULL", "foreign_keys=ON", "secure_delete=ON"):
        raw.execute(f"PRAGMA {pragma}")


def _write_ahead(raw: Any, deadline_s: float) -> None:
    """Turn on the write-ahead log; SQLite's own busy timeout does not apply to that."""
    while True:
        try:
            raw.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            is_busy = error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY
            if not is_busy or time.monotonic() >= deadline_s:
                raise
        time.sleep(RETRY_S)


def _on_begin(connection: Connection) -> None:
    """Serialise transactions on either database, so that none acts on data that is about to change."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    else:
        connection.execute(select(func.pg_advisory_xact_lock(LOCK)))


def _migrate(connection: Connection, name: str) -> None:
    config = AlembicConfig()
    config.set_main_option("path_separator", "os")
    config.set_main_option("script_location", str(resources.files("haptigraph.study") / "migrations"))
    config.attributes["connection"] = connection
    try:
        command.upgrade(config, "head")
    except CommandError:
        raise BadInput("was created by a newer haptigraph; update haptigraph to open it", name) from None


def to_json(value: Any) -> str:
    """Return canonical JSON: equal values give equal texts."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False, allow_nan=False)
