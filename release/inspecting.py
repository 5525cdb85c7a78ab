"""What a compiled library says of itself: format, processor, oldest system, exported functions."""

import re
from pathlib import Path

import lief

from release.targets import Target

__all__ = ["problems_of"]

GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)")


def problems_of(library: Path, target: Target, names: set[str]) -> list[str]:
    """Return why a library is not one for a platform; empty if it is.

    Args:
        library: The file.
        target: The platform.
        names: What it must export.
    """
    binary = lief.parse(str(library))
    if isinstance(binary, lief.MachO.FatBinary):
        binary = binary.at(0)
    if binary is None:
        return [f"{library.name} is no library of a known format"]
    problems = _identity(binary, target)
    found = {str(symbol.name).removeprefix("_") for symbol in binary.exported_functions}
    found |= {str(symbol.name).removeprefix("_") for symbol in getattr(binary, "exported_symbols", ())}
    if missing := sorted(names - found):
        problems.append(f"lacks {', '.join(missing)}")
    return problems


def _identity(binary: lief.Binary, target: Target) -> list[str]:
    processor, system, *_ = target.zig.replace(".", "-").split("-")
    if isinstance(binary, lief.ELF.Binary):
        found = {lief.ELF.ARCH.X86_64: "x86_64", lief.ELF.ARCH.AARCH64: "aarch64"}.get(
            binary.header.machine_type
        )
        return _mismatch(found, "linux", processor, system) + _foreign_libraries(binary, target)
    if isinstance(binary, lief.MachO.Binary):
        cpu = {lief.MachO.Header.CPU_TYPE.X86_64: "x86_64", lief.MachO.Header.CPU_TYPE.ARM64: "aarch64"}
        oldest = tuple(binary.build_version.minos[:2]) if binary.has_build_version else None
        problems = [] if oldest == (11, 0) else [f"needs macOS {oldest}, not 11.0"]
        return _mismatch(cpu.get(binary.header.cpu_type), "macos", processor, system) + problems
    is_pe64 = binary.header.machine == lief.PE.Header.MACHINE_TYPES.AMD64
    return _mismatch("x86_64" if is_pe64 else None, "windows", processor, system)


def _mismatch(processor: str | None, system: str, *expected: str) -> list[str]:
    return [] if (processor, system) == expected else [f"is for {system} {processor}, not {expected}"]


def _foreign_libraries(binary: lief.ELF.Binary, target: Target) -> list[str]:
    found = re.search(r"gnu\.(\d+)\.(\d+)", target.zig)
    names = {
        version.name
        for requirement in binary.symbols_version_requirement
        for version in requirement.get_auxiliary_symbols()
    }
    needs = {str(name) for name in binary.libraries}
    foreign = sorted(needs - {"libc.so"}) if "musl" in target.zig else []
    versions = {name: tuple(map(int, parts)) for name in names for parts in GLIBC.findall(str(name))}
    limit = tuple(map(int, found.groups())) if found else (0, 0)
    return [f"needs {name}" for name, version in sorted(versions.items()) if version > limit] + [
        f"needs {name}" for name in foreign
    ]
