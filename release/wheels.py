"""Build, check and try the wheels of all platforms: `make wheels`.

Writes an sdist and a wheel per platform into dist/, and prints a table. The wheels are built from the
unpacked sdist, so that it is complete. Exit code 1: a wheel is not what it should be, or was not tried.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from release.exports import exported_names
from release.inspecting import problems_of
from release.targets import TARGETS, Target

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
LIBRARY = "haptigraph/perception/native/native.library"
ZIG = (sys.executable, "-m", "ziglang", "cc")
UNTRIED = "not tried: nothing here runs it"


class Result(NamedTuple):
    """What was found out about one wheel."""

    wheel: Path
    problems: list[str]
    digits: str
    """Of the harness: "equal", why it was not tried, or what differs."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing is wrong with it, as far as it was tried."""
        return not self.problems and self.digits in ("equal", UNTRIED)


def main() -> int:
    """Build everything; return the exit code."""
    shutil.rmtree(DIST, ignore_errors=True)
    with TemporaryDirectory() as folder:
        sdist = unpacked_sdist(Path(folder))
        expected = local_digits(sdist)
        results = [judge(target, sdist, expected) for target in TARGETS]
    for target, result in zip(TARGETS, results, strict=True):
        size_kb = result.wheel.stat().st_size / 1e3
        found = "; ".join(result.problems) or "sound"
        print(f"{target.zig:24} {result.wheel.name}  {size_kb:.0f} kB  {found}  digits: {result.digits}")
    packages = sorted(str(file) for file in DIST.iterdir())
    return int(not all(result.is_sound for result in results) or run("twine", "check", "--strict", *packages))


def unpacked_sdist(folder: Path) -> Path:
    """Build the sdist, and unpack it into a folder."""
    if run("hatchling", "build", "--target", "sdist", "--directory", str(DIST), cwd=ROOT):
        sys.exit("the sdist could not be built (see above)")
    (sdist,) = DIST.glob("*.tar.gz")
    shutil.unpack_archive(sdist, folder)
    return folder / sdist.name.removesuffix(".tar.gz")


def local_digits(sdist: Path) -> str:
    """Return what the harness prints about a library by this machine's own compiler."""
    with TemporaryDirectory() as folder:
        library = Path(folder, "native.library")
        if subprocess.run([sys.executable, "hatch_build.py", str(library)], cwd=sdist).returncode:
            sys.exit("the library could not be compiled here (see above)")
        return run_harness(TARGETS[0], sdist, library)


def build(target: Target, sdist: Path) -> Path:
    """Build the wheel of a platform."""
    environment = {
        **os.environ,
        "CC": " ".join((*ZIG, "-target", target.zig, "-s")),
        "WHEEL_PLATFORM": target.tag,
    }
    if run("hatchling", "build", "--target", "wheel", "--directory", str(DIST), cwd=sdist, env=environment):
        sys.exit(f"the wheel for {target.tag} could not be built (see above)")
    (wheel,) = DIST.glob(f"*-{target.tag}.whl")
    return wheel


def judge(target: Target, sdist: Path, expected: str) -> Result:
    """Build the wheel of a platform and try it."""
    wheel = build(target, sdist)
    with TemporaryDirectory() as folder:
        library = extracted(wheel, Path(folder))
        problems = problems_of(library, target, exported_names(sdist / Path(LIBRARY).parent))
        problems += audit(wheel, target)
        if target.runner is None:
            return Result(wheel, problems, UNTRIED)
        if target.runner and not shutil.which(target.runner[0]):
            return Result(wheel, problems, f"not tried: install the Debian packages {target.packages}")
        digits = run_harness(target, sdist, library)
    return Result(wheel, problems, "equal" if digits == expected else f"differ:\n{digits}")


def audit(wheel: Path, target: Target) -> list[str]:
    """Return what auditwheel finds wrong with a wheel for glibc; on glibc it cannot read one for musl."""
    if "gnu." not in target.zig:
        return []
    command = [sys.executable, "-m", "auditwheel", "show", str(wheel)]
    text = " ".join(subprocess.run(command, capture_output=True, text=True).stdout.split())
    tag = target.tag.partition(".")[0]
    return [] if f'"{tag}"' in text or "no external" in text else [f"auditwheel: {text}"]


def extracted(wheel: Path, folder: Path) -> Path:
    """Return the compiled library of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return Path(archive.extract(LIBRARY, folder))


def run_harness(target: Target, sdist: Path, library: Path) -> str:
    """Return what the harness prints about a library."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / ("harness.exe" if "windows" in target.zig else "harness")
        include = f"-I{sdist / Path(LIBRARY).parent}"
        source = str(sdist / "release/harness.c")
        dynamic = ("-dynamic",) if "linux" in target.zig else ()
        command = (*ZIG, "-target", target.zig, *dynamic, "-O1", include, "-o", str(program), source)
        if subprocess.run(command).returncode:
            return "the harness could not be compiled"
        environment = {**os.environ, "WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
        done = subprocess.run(
            (*(target.runner or ()), str(program), str(library)),
            capture_output=True,
            text=True,
            env=environment,
            cwd=folder,
        )
        return done.stdout.replace("\r", "") or done.stderr or f"exit code {done.returncode}"


def run(module: str, *arguments: str, cwd: Path | None = None, env: dict[str, str] | None = None) -> int:
    """Run a module of this environment; return its exit code."""
    command: Sequence[str] = (sys.executable, "-m", module, *arguments)
    return subprocess.run(command, cwd=cwd, env=env).returncode


if __name__ == "__main__":
    sys.exit(main())
