"""What `make` installs: `live` and `demo` the base package alone, everything else all of it."""

import re
import subprocess

import pytest
from paths import ROOT


def pinned(file: str) -> dict[str, list[str]]:
    """Return the versions in a lock file by package."""
    versions: dict[str, list[str]] = {}
    for name, version in re.findall(
        r"^([a-z0-9.-]+)(?:\[[^]]*\])?==(\S+)", (ROOT / file).read_text(), re.MULTILINE
    ):
        versions.setdefault(name, []).append(version)
    return versions


def test_the_base_has_the_versions_of_the_whole():
    base, whole = pinned("requirements-base.lock"), pinned("requirements.lock")
    assert {name: whole.get(name) for name in base} == base
    assert len(base) < len(whole) / 3


def test_the_base_has_what_the_package_and_its_build_need():
    text = (ROOT / "pyproject.toml").read_text()
    (needed,) = re.findall(r"^dependencies = \[\n(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    names = set(re.findall(r'"([a-z-]+)', needed))
    assert names | {"hatchling", "editables"} <= set(pinned("requirements-base.lock"))


@pytest.mark.parametrize(
    ("target", "files"),
    [
        ("live", ["requirements-base.lock"]),
        ("demo", ["requirements-base.lock"]),
        ("setup", ["requirements-base.lock", "requirements.lock"]),
        ("test", ["requirements-base.lock", "requirements.lock"]),
    ],
)
def test_a_fresh_checkout_installs_what_the_target_needs(target, files, tmp_path):
    command = ["make", "-C", ROOT, "--dry-run", f"VENV={tmp_path / 'fresh'}", target]
    planned = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"--requirement (\S+)", planned) == files
    installs = [line for line in planned.splitlines() if files[0] in line]
    assert installs and not any("--quiet" in line for line in installs)
    assert planned.count("--editable .") == 1
