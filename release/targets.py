"""The platforms that wheels are built for: tag, Zig's name, and what runs their code on Linux x86_64."""

from typing import NamedTuple

__all__ = ["TARGETS", "Target"]


class Target(NamedTuple):
    """One platform."""

    tag: str
    """Of the wheel, as package indexes accept it (PEP 600, PEP 656)."""
    zig: str
    """Processor, system and C library; for glibc and macOS with the oldest version."""
    runner: tuple[str, ...] | None
    """Command that runs its programs here; None: nothing does."""
    packages: str = ""
    """Debian packages with the runner."""


TARGETS = (
    Target("manylinux_2_17_x86_64.manylinux2014_x86_64", "x86_64-linux-gnu.2.17", ()),
    Target(
        "manylinux_2_17_aarch64.manylinux2014_aarch64",
        "aarch64-linux-gnu.2.17",
        ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"),
        "qemu-user libc6-arm64-cross",
    ),
    Target("musllinux_1_2_x86_64", "x86_64-linux-musl", ("/lib/ld-musl-x86_64.so.1",), "musl"),
    Target(
        "musllinux_1_2_aarch64",
        "aarch64-linux-musl",
        ("qemu-aarch64", "/lib/ld-musl-aarch64.so.1"),
        "qemu-user musl:arm64",
    ),
    Target("macosx_11_0_x86_64", "x86_64-macos.11.0", None),
    Target("macosx_11_0_arm64", "aarch64-macos.11.0", None),
    Target("win_amd64", "x86_64-windows-gnu", ("/usr/lib/wine/wine64",), "wine64"),
)
