"""Compile the C part of perception when the package is built or installed.

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
LIBRARY = FOLDER / "native.library"  # not .so, which Python would import as a module
FLAGS = (
    *("-std=c11", "-O3", "-shared", "-fPIC", "-fvisibility=hidden"),
    *("-ffp-contract=off", "-fno-math-errno"),  # the same digits everywhere; sqrt is one instruction
    "-fno-trapping-math",  # changes no digit; choices by value become vectors, as nobody asks for traps
)
ZIG = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]  # its default is this very processor
NAMES = ("cc", "gcc", "clang")
HELP = "install gcc or clang, or name a C compiler that works in CC"
PROBE = "#include <math.h>\n#include <stdint.h>\nint32_t probe(double x) { return (int32_t)sqrt(x); }\n"


def compiler() -> list[str]:
    """Return the command of a C compiler: CC if set, else the first on PATH that works, else PyPI's Zig."""
    named = os.environ.get("CC", "")
    if named:
        return [named] if shutil.which(named) else shlex.split(named)
    return next(([name] for name in NAMES if shutil.which(name) and _works(name)), ZIG)


def _works(name: str) -> bool:
    """Return whether a command compiles a few lines; macOS has a cc that does not, without its tools."""
    with TemporaryDirectory() as folder:
        source, library = Path(folder, "probe.c"), Path(folder, "probe.library")
        source.write_text(PROBE)
        command = [name, "-o", str(library), *FLAGS, str(source), "-lm"]
        try:
            return not subprocess.run(command, capture_output=True).returncode and library.exists()
        except OSError:
            return False


def compile_native(library: Path = LIBRARY, *more_flags: str) -> None:
    """Compile the C sources into a library that contains their checksum.

    Raises:
        SystemExit: In a sentence, if there is no compiler or it fails.
    """
    command = compiler()
    if command is ZIG and not find_spec("ziglang"):
        tried = "CC is not set, no cc, gcc or clang on PATH works, the package ziglang is not installed"
        sys.exit(f"no C compiler: {tried}; {HELP}")
    sources = sorted(FOLDER.rglob("*.[ch]"))
    checksum = zlib.crc32(b"".join(source.read_bytes() for source in sources))
    compiled = [str(source) for source in sources if source.suffix == ".c"]
    arguments = [*FLAGS, *more_flags, f"-I{FOLDER}", f"-DSOURCES={checksum}u", *compiled, "-lm"]
    try:
        with TemporaryDirectory(dir=library.parent) as folder:  # a running process never meets half a library
            made = Path(folder, library.name)
            if subprocess.run([*command, "-o", str(made), *arguments]).returncode:
                sys.exit(f"{shlex.join(command)} could not compile {FOLDER} (see above); {HELP}")
            os.replace(made, library)
    except OSError as error:
        sys.exit(f"cannot compile the C part of haptigraph: {error.strerror}: {error.filename}; {HELP}")


class CompileNative(BuildHookInterface[Any]):
    """Compiles in place before files are collected, for a wheel as for an editable installation."""

    def dependencies(self) -> list[str]:
        """Request Zig where no other compiler works."""
        return ["ziglang"] if compiler() is ZIG else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and mark the wheel as one for any Python of this platform, or of WHEEL_PLATFORM."""
        compile_native()
        platform = os.environ.get("WHEEL_PLATFORM") or next(
            tag for tag in platform_tags() if "manylinux" not in tag and "musllinux" not in tag
        )
        build_data["artifacts"].append(f"/{LIBRARY.relative_to(self.root).as_posix()}")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform}"


if __name__ == "__main__":
    compile_native(Path(sys.argv[1]) if sys.argv[1:] else LIBRARY, *sys.argv[2:])
