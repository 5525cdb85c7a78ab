import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from ctypes import c_double
from fnmatch import fnmatch
from pathlib import Path

import hatchling.build
import numpy as np
import pytest
from helpers import copy_sources
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT

import hatch_build
from haptigraph.perception.native.library import Library

REAL_COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
WRITES_ITS_OUTPUT = 'while [ "$1" != -o ]; do shift; done; : > "$2"'
MEDIAN_OF = '#include "native.h"\nEXPORT double median_of(double *v, int n) { return median(v, n); }\n'


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """The only folder on PATH, without a C compiler; a function adds compilers that work or fail."""
    if sys.platform == "win32":
        pytest.skip("needs a shell")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))

    def add(name: str, works: bool = True) -> Path:
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{WRITES_ITS_OUTPUT if works else 'echo no tools >&2; exit 1'}\n")
        program.chmod(0o755)
        return program

    return add


@pytest.fixture
def sources(tmp_path, monkeypatch):
    """A folder of its own with a few C sources, which are compiled instead."""
    folder = tmp_path / "native"
    (folder / "oct").mkdir(parents=True)
    for name in ("native.h", "median.c", "interface.c", "tip_network.h", "oct/bscan.h"):
        shutil.copy(hatch_build.FOLDER / name, folder / name)
    monkeypatch.setattr(hatch_build, "FOLDER", folder)
    return folder


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of what the package is built from, without a compiled library."""
    folder = tmp_path_factory.mktemp("checkout")
    copy_sources(folder)
    return folder


def test_cc_names_the_compiler(programs, monkeypatch):
    programs("cc")
    monkeypatch.setenv("CC", "ccache gcc -m64")
    assert hatch_build.compiler() == ["ccache", "gcc", "-m64"]


def test_cc_may_be_a_path_with_spaces(programs, monkeypatch):
    path = str(programs("my cc"))
    monkeypatch.setenv("CC", path)
    assert hatch_build.compiler() == [path]


def test_otherwise_it_is_the_first_on_path(programs):
    programs("clang")
    assert hatch_build.compiler() == ["clang"]
    programs("gcc")
    assert hatch_build.compiler() == ["gcc"]


@pytest.mark.parametrize("script", ["echo no tools >&2; exit 1", "", "exit 0"])
def test_a_compiler_that_does_not_work_is_passed_over(programs, script):
    programs("cc").write_text(f"#!/bin/sh\n{script}\n" if script else "")
    assert hatch_build.compiler() is hatch_build.ZIG
    programs("clang")
    assert hatch_build.compiler() == ["clang"]


def test_a_named_compiler_that_fails_is_an_error(programs, sources, monkeypatch):
    monkeypatch.setenv("CC", str(programs("cc", works=False)))
    programs("gcc")
    with pytest.raises(
        SystemExit, match=r"cc could not compile .*native \(see above\); install gcc or clang"
    ):
        hatch_build.compile_native(sources / "native.library")


@pytest.mark.skipif(REAL_COMPILER is None, reason="needs a C compiler to stand for Zig")
def test_zig_compiles_where_all_others_fail(programs, sources, monkeypatch):
    for name in hatch_build.NAMES:
        programs(name, works=False)
    monkeypatch.setenv(
        "PATH", f"{os.environ['PATH']}{os.pathsep}{os.defpath}"
    )  # for the tools of the compiler
    monkeypatch.setattr(hatch_build, "ZIG", [REAL_COMPILER])  # in its place: Zig may not be installed
    monkeypatch.setattr(hatch_build, "find_spec", lambda name: True)
    hatch_build.compile_native(sources / "native.library")
    Library(sources / "native.library")


def test_zig_is_required_only_where_no_compiler_works(programs, monkeypatch):
    monkeypatch.chdir(ROOT)
    hooks = hatchling.build.get_requires_for_build_wheel, hatchling.build.get_requires_for_build_editable
    for works in (None, False, True):
        if works is not None:
            programs("cc", works)
        assert all(("ziglang" in "".join(hook())) != bool(works) for hook in hooks)
    assert hatchling.build.get_requires_for_build_sdist() == []


def test_without_any_compiler_a_sentence_says_what_helps(programs, monkeypatch):
    monkeypatch.setattr(hatch_build, "find_spec", lambda name: None)
    with pytest.raises(SystemExit, match=r"no C compiler: CC is not set, .*; install gcc or clang"):
        hatch_build.compile_native()


def test_a_compiler_that_does_not_exist_is_named(sources, monkeypatch):
    monkeypatch.setenv("CC", "no-such-cc")
    with pytest.raises(SystemExit, match=r"No such file.*no-such-cc; install gcc or clang, or name"):
        hatch_build.compile_native(sources / "native.library")


def test_sources_with_an_error_leave_the_old_library(sources, capfd):
    (sources / "native.library").write_text("old")
    (sources / "broken.c").write_text("int broken(")
    with pytest.raises(SystemExit, match=r"could not compile .*native \(see above\)"):
        hatch_build.compile_native(sources / "native.library")
    assert "broken.c:1" in capfd.readouterr().err
    assert (sources / "native.library").read_text() == "old"
    assert {path.suffix for path in sources.iterdir() if path.is_file()} == {".c", ".h", ".library"}


def test_warnings_are_errors_only_on_request(sources):
    (sources / "unused.c").write_text("static int unused;")
    hatch_build.compile_native(sources / "native.library")
    with pytest.raises(SystemExit, match="could not compile"):
        hatch_build.compile_native(sources / "native.library", "-Wall", "-Werror")


def test_the_median_in_c_is_the_upper_one(sources):
    (sources / "exported.c").write_text(MEDIAN_OF)
    hatch_build.compile_native(sources / "native.library")
    median_of = Library(sources / "native.library").function("median_of", "pi", c_double)

    @given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=60))
    def is_the_upper_one(values):
        assert median_of((c_double * len(values))(*values), len(values)) == np.sort(values)[len(values) // 2]

    is_the_upper_one()


@pytest.mark.slow  # `make wheels` checks and tries wheels
def test_a_wheel_is_for_every_python_of_the_platform(checkout, tmp_path, monkeypatch):
    monkeypatch.chdir(checkout)
    name = hatchling.build.build_wheel(str(tmp_path))
    assert "-py3-none-" in name
    assert not name.endswith("-any.whl")
    with zipfile.ZipFile(tmp_path / name) as wheel:
        native = {Path(entry).name for entry in wheel.namelist() if "/native/" in entry}
        (about,) = (entry for entry in wheel.namelist() if entry.endswith("/WHEEL"))
        assert b"Root-Is-Purelib: false" in wheel.read(about)
    modules = {path.name for path in (checkout / "haptigraph/perception/native").glob("*.py")}
    assert native == {*modules, "native.library"}


def test_an_editable_installation_compiles_in_place(checkout, tmp_path, monkeypatch):
    compiled = checkout / "haptigraph/perception/native/native.library"
    compiled.unlink(missing_ok=True)
    monkeypatch.chdir(checkout)
    with zipfile.ZipFile(tmp_path / hatchling.build.build_editable(str(tmp_path))) as wheel:
        assert not any("native" in entry for entry in wheel.namelist())
    Library(compiled)


def test_the_sdist_has_the_sources_and_what_compiles_them(checkout, tmp_path, monkeypatch):
    (checkout / "haptigraph/perception/native/native.library").touch()
    monkeypatch.chdir(checkout)
    with tarfile.open(tmp_path / hatchling.build.build_sdist(str(tmp_path))) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    assert {
        "hatch_build.py",
        "haptigraph/perception/native/median.c",
        "haptigraph/perception/native/native.h",
    } <= {*names}
    assert not any(name.endswith(".library") for name in names)


def test_the_sdist_includes_everything_that_is_committed():
    sdist = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["sdist"]
    always = [".gitignore", "hatch_build.py", "pyproject.toml"]
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("this is no clone")
    names = {name.partition("/")[0] for name in listed.stdout.splitlines()}
    assert not [
        name for name in names if not any(fnmatch(name, each) for each in [*always, *sdist["include"]])
    ]


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


def test_networks_are_trained_with_the_versions_that_run_them():
    training, whole = pinned("requirements-training.lock"), pinned("requirements.lock")
    shared = set(training) & set(whole) - {"setuptools"}
    assert {"numpy", "onnx", "onnxruntime", "opencv-python-headless"} <= shared
    assert {name: training[name] for name in shared} == {name: whole[name] for name in shared}
    assert len(training["torch"]) == 1  # the same network needs the same version


def test_the_base_has_what_the_package_its_build_and_the_figure_of_the_demo_need():
    text = (ROOT / "pyproject.toml").read_text()
    (needed,) = re.findall(r"^dependencies = \[\n(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    names = set(re.findall(r'"([a-z-]+)', needed))
    assert names | {"hatchling", "editables", "matplotlib"} <= set(pinned("requirements-base.lock"))


@pytest.mark.parametrize(
    ("target", "files"),
    [
        ("live", ["requirements-base.lock"]),
        ("demo", ["requirements-base.lock"]),
        ("setup", ["requirements-base.lock", "requirements.lock"]),
        ("test", ["requirements-base.lock", "requirements.lock"]),
        ("train", ["requirements-base.lock", "requirements.lock", "requirements-training.lock"]),
    ],
)
def test_a_fresh_checkout_installs_what_the_target_needs(target, files, tmp_path):
    command = ["make", "-C", ROOT, "--dry-run", f"VENV={tmp_path / 'fresh'}", target]
    planned = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"uv pip install .*--requirement (\S+) \|\|", planned) == files
    assert re.findall(r"python -m pip install .*--requirement (\S+)$", planned, re.MULTILINE) == files
    installs = [line for line in planned.splitlines() if files[0] in line]
    assert installs and not any("--quiet" in line for line in installs)
    assert planned.count("--editable .") == 1


def test_all_has_every_extra_but_that_of_a_makers_sdk():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = re.findall(r"haptigraph\[([^]]*)\]", " ".join(extras.pop("all")))
    assert set(extras) - set(",".join(named).split(",")) == {"forcedimension"}
