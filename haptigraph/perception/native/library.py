"""The compiled library, loaded and verified: its functions, constants and struct layouts by name.

The library describes itself (`interface.c`), so Python repeats no offset, size or constant of it.
"""

import ctypes
import struct
import zlib
from pathlib import Path
from typing import Any

from haptigraph.errors import NotCompiled

__all__ = ["LIBRARY", "Library", "pack"]

_TYPES: dict[str, Any] = {
    "p": ctypes.c_void_p,
    "i": ctypes.c_int,
    "n": ctypes.c_ssize_t,
    "d": ctypes.c_double,
    "f": ctypes.c_float,
}
_INTEGERS = {"p": {4: "I", 8: "Q"}, "i": {4: "i", 8: "q"}}  # formats of `struct` by size


class _Entry(ctypes.Structure):
    """What the library exports about a constant, a struct or a field."""

    _fields_ = (("name", ctypes.c_char_p), ("value", ctypes.c_int32), ("size", ctypes.c_int32))


class Library:
    """A compiled library.

    Args:
        file: The library; in a checkout, its C sources are beside it.

    Raises:
        NotCompiled: If it is missing, cannot be loaded or was compiled from other sources.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        if not file.exists():
            raise NotCompiled(file, "is missing")
        try:
            self._library = ctypes.CDLL(str(file))
            checksum = ctypes.c_uint32.in_dll(self._library, "sources").value
            first = _Entry.in_dll(self._library, "entries")
        except (OSError, ValueError) as error:
            raise NotCompiled(file, f"cannot be loaded ({error})") from None
        self.sources_crc32 = checksum
        """CRC-32 of the C sources from which it was compiled."""
        sources = sorted(file.parent.rglob("*.[ch]"))
        if sources and checksum != zlib.crc32(b"".join(source.read_bytes() for source in sources)):
            raise NotCompiled(file, "was compiled from other C sources than those beside it")
        entries = ctypes.cast(ctypes.pointer(first), ctypes.POINTER(_Entry))
        self._entries: dict[str, tuple[int, int]] = {}
        while entries[len(self._entries)].name:
            entry = entries[len(self._entries)]
            self._entries[entry.name.decode()] = entry.value, entry.size

    def constant(self, name: str) -> int:
        """Return the value of a constant, or the size of a struct."""
        if name not in self._entries:
            raise NotCompiled(self._file, f"lacks {name}")
        return self._entries[name][0]

    def layout(self, name: str, *groups: tuple[str, str]) -> struct.Struct:
        """Return the format of a C struct.

        Args:
            name: The struct.
            groups: Its fields in order, each group of one kind: p address, i integer, d one or more doubles.
        """
        kinds = {f"{name}.{field}": kind for kind, fields in groups for field in fields.split()}
        at, layout = 0, "="
        try:
            if list(kinds) != [key for key in self._entries if key.startswith(f"{name}.")]:
                raise KeyError(name)
            for field, kind in kinds.items():
                offset, size = self._entries[field]
                value = f"{size // 8}d" if kind == "d" else _INTEGERS[kind][size]
                layout, at = f"{layout}{offset - at}x{value}", offset + size
            return struct.Struct(f"{layout}{self.constant(name) - at}x")
        except (KeyError, struct.error):
            raise NotCompiled(self._file, f"lays {name} out in another way than this version") from None

    def function(self, name: str, takes: str, returns: Any = None) -> Any:
        """Return a C function; only its wrapper may call it.

        Args:
            name: The function.
            takes: A letter per argument: p pointer, i int, n ptrdiff_t, d double, f float.
            returns: Its ctypes type, None for void.
        """
        try:
            function = self._library[name]
        except AttributeError:
            raise NotCompiled(self._file, f"lacks {name}") from None
        function.argtypes = [_TYPES[letter] for letter in takes]
        function.restype = returns
        return function


def pack(layout: struct.Struct, *values: Any) -> bytes:
    """Return a C struct.

    Raises:
        TypeError: If a value is not of its field's type or does not fit it.
    """
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise TypeError(f"cannot pass {values} to C: {error}") from None


LIBRARY = Library(Path(__file__).with_name("native.library"))
"""The library of this installation."""
