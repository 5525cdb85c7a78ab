"""The origin of a result: the software is identified by content, the commit only in its own checkout."""

import shutil
import subprocess
from pathlib import Path

import pytest

from haptigraph.analysis.evaluation import origin
from haptigraph.version import __version__


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A small package in a folder of its own."""
    folder = tmp_path / "haptigraph"
    (folder / "room").mkdir(parents=True)
    (folder / "room" / "module.py").write_text("A = 1\n")
    monkeypatch.setattr(origin, "PACKAGE", folder)
    for function in (origin.commit, origin.software_sha256):
        monkeypatch.setattr(origin, function.__name__, function.__wrapped__)
    return folder


def git(folder: Path, *arguments: str) -> str:
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_the_hash_follows_the_content_and_not_what_only_some_installations_have(package):
    before = origin.software_sha256()
    (package / "room" / "code.c").write_text("int a;")
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "module.pyc").write_text("")
    assert origin.software_sha256() == before
    (package / "room" / "module.py").write_text("A = 2\n")
    assert origin.software_sha256() != before


@pytest.mark.skipif(not shutil.which("git"), reason="needs git")
def test_the_commit_is_that_of_the_checkout_and_says_if_the_package_was_changed(package):
    assert origin.commit() == ""
    git(package.parent, "init")
    git(package.parent, "add", ".")
    git(package.parent, "commit", "-m", "first")
    head = git(package.parent, "rev-parse", "HEAD")
    assert origin.commit() == head
    (package.parent / "notes.md").write_text("other")
    assert origin.commit() == head
    (package / "room" / "module.py").write_text("A = 2\n")
    assert origin.commit() == f"{head} with uncommitted changes"


@pytest.mark.skipif(not shutil.which("git"), reason="needs git")
def test_a_package_installed_inside_another_project_has_no_commit(package, monkeypatch):
    git(package.parent, "init")
    inner = package.parent / "site-packages" / "haptigraph"
    shutil.copytree(package, inner)
    monkeypatch.setattr(origin, "PACKAGE", inner)
    assert origin.commit() == ""


def test_without_git_there_is_no_commit(package, monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert origin.commit() == ""


def test_a_result_states_version_date_and_command():
    made = origin.new_origin(command="haptigraph evaluate")
    assert (made.version, made.command, made.procedure) == (__version__, "haptigraph evaluate", "")
    assert made.made_utc.endswith("+00:00")
