"""Compiles the C part of perception when the package is built or installed.

`python hatch_build.py [FILE [FLAG ...]]` does so by hand: in place or into FILE, with more flags.
"""

import os
import shlex
import shutil
import subprocess
import sys
import zlib
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags

FOLDER = Path(__file__).parent / "haptigraph/perception/native"
LIBRARY = FOLDER / "native.library"  # not .so, which Python would take for a module
FLAGS = (
    *("-std=c11", "-O3", "-shared", "-fPIC", "-fvisibility=hidden"),
    *("-ffp-contract=off", "-fno-math-errno"),  # the same digits everywhere; sqrt is one instruction
)
ZIG = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]  # else for this very processor
HELP = "install gcc or clang, or name a C compiler that works in CC"


def compiler() -> list[str]:
    """Return the command of a C compiler: what CC says, else the first on PATH, else Zig's from PyPI."""
    named = os.environ.get("CC", "")
    if named:
        return [named] if shutil.which(named) else shlex.split(named)
    return next(([name] for name in ("cc", "gcc", "clang") if shutil.which(name)), ZIG)


def compile_native(library: Path = LIBRARY, *more_flags: str) -> None:
    """Compile the sources into a library that knows which sources these were.

    Raises:
        SystemExit: In a sentence, if there is no compiler or it fails.
    """
    command = compiler()
    if command is ZIG and not find_spec("ziglang"):
        looked = "CC is not set, cc, gcc and clang are not on PATH, the package ziglang is not installed"
        sys.exit(f"no C compiler: {looked}; {HELP}")
    sources = sorted(FOLDER.glob("*.[ch]"))
    checksum = zlib.crc32(b"".join(source.read_bytes() for source in sources))
    arguments = [*FLAGS, *more_flags, f"-DSOURCES={checksum}u", *map(str, sorted(FOLDER.glob("*.c"))), "-lm"]
    try:
        with TemporaryDirectory(dir=library.parent) as folder:  # who runs never meets half a library
            made = Path(folder, library.name)
            if subprocess.run([*command, "-o", str(made), *arguments]).returncode:
                sys.exit(f"{shlex.join(command)} could not compile {FOLDER} (see above); {HELP}")
            os.replace(made, library)
    except OSError as error:
        sys.exit(f"cannot compile the C part of haptigraph: {error.strerror}: {error.filename}; {HELP}")


class CompileNative(BuildHookInterface[Any]):
    """Compiles in place before files are collected, for a wheel as for an editable installation."""

    def dependencies(self) -> list[str]:
        """Ask for Zig where there is no other compiler."""
        return ["ziglang"] if compiler() is ZIG else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and tell that the wheel is for any Python of this platform."""
        compile_native()
        platform = next(tag for tag in platform_tags() if "manylinux" not in tag and "musllinux" not in tag)
        build_data["artifacts"].append(f"/{LIBRARY.relative_to(self.root).as_posix()}")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform}"


if __name__ == "__main__":
    compile_native(Path(sys.argv[1]) if sys.argv[1:] else LIBRARY, *sys.argv[2:])
