"""The checklist of a release finds each thing that is missing."""

import subprocess

import pytest

from release import check
from release.targets import TARGETS

PROJECT = '[project]\nauthors = [{ name = "A", email = "a@example.org" }]\nurls = { Repository = "https://example.org" }\n'
FILES = {
    "haptigraph/version.py": '__version__ = "1.2.0"\n',
    "CHANGELOG.md": "# Changes\n\n## 1.2.0 (2026-11-26)\n\n## 1.1.0 (2025-01-01)\n",
    "docs/reference/upgrading.md": "# Upgrading from 1.1.0 to 1.2.0\n",
    "CITATION.cff": "cff-version: 1.2.0\nmessage: m\ntitle: t\nversion: 1.2.0\nauthors:\n  - name: A\n",
    "pyproject.toml": PROJECT,
    "dist/haptigraph-1.2.0.tar.gz": "",
    **{f"dist/haptigraph-1.2.0-py3-none-{target.tag}.whl": "" for target in TARGETS},
}
SABOTAGES = {
    "change log": ("CHANGELOG.md", "1.2.0 (2026-11-26)", "[Unreleased]"),
    "upgrading page": ("docs/reference/upgrading.md", "1.2.0", "1.3.0"),
    "citation": ("CITATION.cff", "\nversion: 1.2.0", "\nversion: 1.1.0"),
    "addresses": ("pyproject.toml", ', email = "a@example.org"', ""),
    "commit": ("README.md", "", "new"),
}


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A checkout of which everything is done; twine belongs to make wheels."""
    monkeypatch.setitem(check.ITEMS, "twine", lambda root, version: "")
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    for command in ("init -q", "add .", "-c user.name=A -c user.email=a@b commit -qm A", "tag v1.2.0"):
        subprocess.run(["git", *command.split()], cwd=tmp_path, check=True)
    return tmp_path


def not_done(root, capsys) -> list[str]:
    code = check.main(root)
    lines = capsys.readouterr().out.splitlines()
    missing = [line[10:].partition(":")[0] for line in lines[1:] if line.startswith("not done")]
    assert lines[0] == "haptigraph 1.2.0" and len(lines) == 9 and code == bool(missing)
    return missing


def test_nothing_is_missing(root, capsys):
    assert not_done(root, capsys) == []


@pytest.mark.parametrize("item", SABOTAGES)
def test_each_sabotage_is_found(item, root, capsys):
    name, old, new = SABOTAGES[item]
    file = root / name
    file.write_text(file.read_text().replace(old, new) if file.exists() else new)
    assert item in not_done(root, capsys)


def test_a_missing_wheel_and_a_missing_tag_are_found(root, capsys):
    next((root / "dist").glob("*win*")).unlink()
    subprocess.run(["git", "tag", "-d", "v1.2.0"], cwd=root, check=True, capture_output=True)
    assert {"packages", "tag"} <= {*not_done(root, capsys)}


def test_a_package_of_another_version_is_found(root, capsys):
    (root / "dist/haptigraph-1.1.0.tar.gz").touch()
    assert "packages" in not_done(root, capsys)
