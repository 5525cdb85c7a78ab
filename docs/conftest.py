"""Pages as tests: `pytest docs` executes every block of every page; see snippets.py."""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from snippets import parse, setup, teardown
from sybil import Sybil

FOLDERS: list[tempfile.TemporaryDirectory[str]] = []


def _setup(namespace: dict) -> None:
    FOLDERS.append(tempfile.TemporaryDirectory(prefix="haptigraph-docs-"))
    setup(namespace, Path(FOLDERS[-1].name))


def _teardown(namespace: dict) -> None:
    teardown(namespace)
    FOLDERS.pop().cleanup()


pytest_collect_file = Sybil(
    parsers=[parse],
    patterns=["**/*.md"],
    excludes=["decisions/*"],
    setup=_setup,
    teardown=_teardown,
).pytest()
