"""The package is typed: a user's program is checked against the wheel under `mypy --strict`."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import hatchling.build
import pytest
from helpers import copy_sources

import haptigraph

PROGRAM = '''
"""Uses every public name; what mypy must reject is marked, and an unused mark is an error."""

from typing import assert_type

import haptigraph
from haptigraph import (
    Capture,
    Config,
    HaptigraphError,
    RunReader,
    SceneGraph,
    Step,
    Triplet,
    build,
    load_config,
    load_procedure,
    load_registration,
)
from haptigraph.stages import Source


def states(uri: str) -> set[str]:
    config = load_config(settings=(f"source.uri={uri}",))
    assert_type(config, Config)
    found: set[str] = set()
    for step in build(config).steps():
        assert_type(step, Step)
        assert_type(step.graph, SceneGraph)
        found.add(step.conclusion.state)
    return found


def evidence(path: str) -> list[Triplet]:
    try:
        return [edge for _, step in RunReader(path).records() for edge in step.conclusion.evidence]
    except HaptigraphError:
        return []


class MySource(Source):
    rate_hz, is_live = 30.0, False

    def read(self, timeout_s: float) -> Capture | None:
        return None

    def close(self) -> None:
        pass


assert_type(MySource().notes, tuple[str, ...])
assert_type(haptigraph.__version__, str)
assert_type(Config().haptics.deadman_ms, float)
Config().nothing  # type: ignore[attr-defined]
assert_type(load_procedure("subretinal_injection").name, str)
assert_type(load_registration("eye.toml").width_px, int)
build("phantom:x")  # type: ignore[arg-type]
haptigraph.nothing  # type: ignore[attr-defined]
'''


def test_tab_completion_offers_the_public_names():
    assert dir(haptigraph) == haptigraph.__all__
    for name in dir(haptigraph):
        assert getattr(haptigraph, name) is not None


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """An environment with the wheel of this checkout, and the libraries of this one."""
    checkout, environment = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("environment")
    copy_sources(checkout)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(checkout)
        wheel = checkout / hatchling.build.build_wheel(str(checkout))
    venv.create(environment, symlinks=True)
    scheme = {"base": str(environment), "platbase": str(environment)}
    site = Path(sysconfig.get_path("purelib", "venv", scheme))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site / "libraries.pth").write_text("\n".join(libraries))
    return environment


def test_a_strictly_typed_program_is_checked_against_the_wheel(environment, tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    command = [sys.executable, "-m", "mypy", "--strict", f"--python-executable={python}"]
    done = subprocess.run(
        [*command, f"--cache-dir={tmp_path / 'cache'}", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout == "Success: no issues found in 1 source file\n", done.stdout + done.stderr
