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

from matplotlib.figure import Figure

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


def looked_at(path: str) -> None:
    with RunReader(path) as run:
        assert_type(run, RunReader)
        assert_type(len(run), int)
        assert_type(run[10], Step)
        assert_type(run[10:20], list[Step])
        assert_type(run.at_s[2.5], Step)
        assert_type([step.conclusion.state for step in run.at_s[2.5:4]], list[str])
        assert_type(run.capture(3), Capture)
        assert_type(run.plot(), Figure)
        assert_type(run[10].graph.plot(), Figure)
        for step in run:
            assert_type(step, Step)
        run["first"]  # type: ignore[call-overload]
        run.to_dataframe()
        run.to_xarray()


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


@pytest.mark.parametrize(
    ("expression", "names"),
    [
        ("run", {"at_s", "capture", "info", "plot", "records", "to_dataframe", "to_xarray"}),
        ("run[10]", {"conclusion", "graph", "index", "observation", "stamp_ns"}),
        ("run.at_s[2.5].conclusion", {"because", "evidence", "feel", "state"}),
        ("haptigraph.load_procedure('x')", {"name", "sha256", "states"}),
        ("haptigraph.build(haptigraph.load_config()).report", {"faults", "rate_hz", "steps"}),
    ],
)
def test_tab_completes_what_nobody_has_run(expression, names):
    jedi = pytest.importorskip("jedi")
    typed = f"import haptigraph\nrun = haptigraph.RunReader('run.mcap')\n{expression}."
    project = jedi.Project(str(Path(haptigraph.__file__).parents[1]))
    assert {completion.name for completion in jedi.Script(typed, project=project).complete()} >= names


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


@pytest.mark.slow
def test_a_strictly_typed_program_is_checked_against_the_wheel(environment, tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    command = [sys.executable, "-m", "mypy", "--strict", f"--python-executable={python}"]
    done = subprocess.run(
        [*command, f"--cache-dir={tmp_path / 'cache'}", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout == "Success: no issues found in 1 source file\n", done.stdout + done.stderr
