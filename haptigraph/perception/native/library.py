"""Functions of the compiled part of perception, ready to be called.

Turns names of C functions into callables, and arrays into what these take. Knows nothing of what they do.
"""

import ctypes
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import NotCompiled

__all__ = ["address", "function", "rows"]


def _load(file: Path) -> ctypes.CDLL:
    if not file.exists():
        raise NotCompiled(file, "is missing")
    try:
        library = ctypes.CDLL(str(file))
        made_of = ctypes.c_uint32.in_dll(library, "sources").value
    except (OSError, ValueError) as error:
        raise NotCompiled(file, f"cannot be loaded ({error})") from None
    sources = sorted(file.parent.glob("*.[ch]"))  # in a checkout; a wheel has none
    if sources and made_of != zlib.crc32(b"".join(source.read_bytes() for source in sources)):
        raise NotCompiled(file, "was compiled from other C sources than those beside it")
    return library


_LIBRARY = _load(Path(__file__).with_name("native.library"))
_FLOAT = np.dtype(np.float32)
_POINTER_AT = object.__basicsize__  # in NumPy's arrays the address of the values follows Python's own fields
_size_at = ctypes.c_size_t.from_address
_TYPES: dict[str, Any] = {
    "p": ctypes.c_void_p,
    "i": ctypes.c_int,
    "n": ctypes.c_ssize_t,
    "d": ctypes.c_double,
    "f": ctypes.c_float,
}


def function(name: str, takes: str, returns: Any = None) -> Any:
    """Return a C function.

    Args:
        name: Of the function.
        takes: A letter for each argument: p pointer, i int, n ptrdiff_t, d double, f float.
        returns: Its ctypes type, None for void.
    """
    found = _LIBRARY[name]
    found.argtypes = [_TYPES[letter] for letter in takes]
    found.restype = returns
    return found


def address(array: NDArray[Any]) -> int:
    """Return where an array's first value lies; nothing checks that it is one, and outlives the use."""
    return _size_at(id(array) + _POINTER_AT).value  # a seventh of the time of array.ctypes.data


def rows(array: NDArray[np.float32]) -> tuple[int, int]:
    """Return where an array's first value lies, and how many values it is from row to row.

    Args:
        array: (lanes, stations), the values of a row one beside the other.

    Raises:
        ValueError: If it is not such an array of float32.
    """
    strides = array.strides
    if array.dtype != _FLOAT or len(strides) != 2 or strides[1] != 4:
        raise ValueError(
            f"rows are (lanes, stations) of float32, one value beside the other; "
            f"found {array.shape} of {array.dtype}, {strides} bytes apart"
        )
    return address(array), strides[0] // 4
