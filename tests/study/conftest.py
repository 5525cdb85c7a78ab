"""A small protocol, a clock that advances on every call, and stores on both databases."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import postgres
import pytest
from protocols import SMALL
from walking import TickingClock

from haptigraph.study.protocol import Protocol, load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.store import Store


@pytest.fixture
def clock() -> TickingClock:
    return TickingClock()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "study.toml").write_text(SMALL)
    return tmp_path


@pytest.fixture
def protocol(folder: Path) -> Protocol:
    return load_protocol(folder)


@pytest.fixture
def store(folder: Path, clock: TickingClock) -> Iterator[Store]:
    with closing(Store(folder / "study.db", clock)) as store:
        yield store


@pytest.fixture
def study(protocol: Protocol, store: Store) -> Study:
    return Study(protocol, store)


@pytest.fixture(scope="session")
def server() -> Iterator[str]:
    if postgres.BINARIES is None:
        pytest.skip("no PostgreSQL server is installed (apt-get install postgresql)")
    with postgres.postgres() as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def where(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Path or URL of an empty store, on either database."""
    if request.param == "sqlite":
        return str(tmp_path / "either.db")
    import psycopg

    url: str = request.getfixturevalue("server")
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("DROP SCHEMA public CASCADE")
        connection.execute("CREATE SCHEMA public")
    return url
