"""Read TOML files into structs.

Every error becomes one sentence: the file, the line, what was found and what would be valid.
"""

import math
import re
import tomllib
import warnings
from collections.abc import Callable
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from haptigraph.errors import BadInput, RenamedKey, unknown_name

__all__ = ["WARN_OF_OLD_KEYS", "Blame", "Document", "convert", "warn_renamed"]

T = TypeVar("T")
Blame = Callable[[str, str], BadInput]
"""Creates the error for (problem, key path)."""
WARN_OF_OLD_KEYS = ContextVar("WARN_OF_OLD_KEYS", default=True)
"""False while a text is read that nobody edits, such as that in a recording."""


class Document:
    """A parsed TOML text that can locate errors in it.

    Args:
        text: The TOML text.
        file: Its name for messages.

    Raises:
        BadInput: If it is not TOML.
    """

    def __init__(self, text: str, file: str | Path) -> None:
        self.text, self.file = text, file
        try:
            self.data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            problem, _, place = str(error).partition(" (at ")
            place = place.rstrip(")") or "end of file"
            raise BadInput(f"not valid TOML: {_lower_first(problem)}", file, place) from None
        except RecursionError:
            raise BadInput("tables or lists are nested too deeply", file) from None

    @classmethod
    def read(cls, path: str | Path) -> "Document":
        """Read a TOML file.

        Raises:
            BadInput: If it cannot be read or is not TOML.
        """
        try:
            return cls(Path(path).read_text(encoding="utf-8-sig"), path)  # editors may add a byte order mark
        except OSError as error:
            raise BadInput(f"cannot be read ({error.strerror})", path) from None
        except UnicodeDecodeError as error:
            raise BadInput(f"not UTF-8 text (byte {error.start})", path) from None

    def error(self, problem: str, path: str) -> BadInput:
        """Return the error for a problem at a key path ("state[2].feel"), with its line."""
        line = _line_of(self.text, path)
        return BadInput(problem, self.file, f"line {line}" if line else "")

    def convert(self, type_: type[T]) -> T:
        """Turn the document into a struct.

        Raises:
            BadInput: At an unknown or missing key, a number that is not finite, or a value of the wrong type.
        """
        return convert(self.data, type_, self.error)


def convert(data: Any, type_: type[T], error: Blame) -> T:
    """Turn parsed TOML into a struct.

    Raises:
        BadInput: Made by `error`, at the first invalid key or value.
    """
    _check_finite(data, "", error)
    _check_names(data, type_, "", error)
    try:
        return msgspec.convert(data, type_)
    except msgspec.ValidationError as invalid:
        problem, _, path = str(invalid).partition(" - at `$")
        path = path.rstrip("`").lstrip(".")
        found = _value_at(data, path)
        name = f"{path}: " if path else ""
        missing = re.match(r"Object missing required field `(\w+)`", problem)
        if missing:
            raise error(f"{name}key {missing[1]!r} is missing", path) from None
        value = "" if found is None or isinstance(found, dict) else f", found {found!r}"
        problem = problem.replace("`", "").replace("object", "table")
        raise error(f"{name}{_lower_first(problem)}{value}", path) from None


def _check_finite(value: Any, path: str, error: Blame) -> None:
    """Reject nan and infinity, which later range checks may let pass."""
    if isinstance(value, float) and not math.isfinite(value):
        raise error(f"{path}: expected a finite number, found {value}", path)
    inner = enumerate(value) if isinstance(value, list) else value.items() if isinstance(value, dict) else ()
    for key, item in inner:
        part = f"[{key}]" if isinstance(value, list) else f".{key}"
        _check_finite(item, (path + part).lstrip("."), error)


def _check_names(value: Any, type_: Any, path: str, error: Blame) -> None:
    """Reject unknown keys and choices with the list of valid ones (msgspec does not list them)."""
    if get_origin(type_) is Literal and isinstance(value, str) and value not in get_args(type_):
        raise error(unknown_name(path.rpartition(".")[2], value, get_args(type_)), path)
    if isinstance(value, list):
        for number, item in enumerate(value):
            for inner in get_args(type_)[:1]:
                _check_names(item, inner, f"{path}[{number}]", error)
    elif isinstance(value, dict):
        struct = next((t for t in (type_, *get_args(type_)) if hasattr(t, "__struct_fields__")), None)
        if struct is None:
            return
        types = _types_of(struct)
        for key, item in list(value.items()):
            inner_path = f"{path}.{key}" if path else key
            if (new := getattr(struct, "OLD_KEYS", {}).get(key)) is not None:
                key = _renamed(value, key, new, inner_path, error)
            if key not in types:
                raise error(unknown_name("key", key, types), inner_path)
            _check_names(item, types[key], inner_path, error)


@cache
def _types_of(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the types of a struct's fields by their keys; resolving them takes most of a check's time."""
    hints = get_type_hints(struct)
    return {
        key: hints[name]
        for key, name in zip(struct.__struct_encode_fields__, struct.__struct_fields__, strict=True)
    }


def _renamed(table: dict[str, Any], old: str, new: str, path: str, error: Blame) -> str:
    """Move a value from its key's name in an earlier version to the current one, with a warning."""
    if new in table:
        raise error(f"both {old!r} and {new!r}, which is its new name; keep {new!r}", path)
    table[new] = table.pop(old)
    warn_renamed(old, new, path, error)
    return new


def warn_renamed(old: str, new: str, path: str, error: Blame) -> None:
    """Warn that a key has its name of an earlier version; `error` adds the location."""
    if WARN_OF_OLD_KEYS.get():
        warnings.warn(str(error(f"key {old!r} is now called {new!r}", path)), RenamedKey, stacklevel=3)


def _value_at(data: Any, path: str) -> Any:
    for part in re.findall(r"\w+", path):
        try:
            data = data[int(part)] if isinstance(data, list) else data[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return data


def _line_of(text: str, path: str) -> int | None:
    """Return the line (from 1) of a key path like "state[2].feel"; its table's line if the key is inline."""
    parts = re.findall(r"(\w+)(?:\[(\d+)\])?", path)
    if not parts:
        return None
    if len(parts) > 1 and re.search(rf"^\s*\[+\s*{parts[0][0]}\.{parts[1][0]}\s*\]", text, re.MULTILINE):
        parts = [
            (f"{parts[0][0]}.{parts[1][0]}", parts[1][1]),
            *parts[2:],
        ]  # a table with a header of its own
    keys = [name for name, _ in parts]
    number = int(parts[0][1] or 0)
    seen: dict[str, int] = {}
    table, table_line = "", None
    for line, content in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*(\[\[?)\s*([\w.]+)\s*\]", content)
        if header:
            table = header[2]
            seen[table] = seen.get(table, -1) + 1
            if table == keys[0] and (header[1] == "[" or seen[table] == number):
                table_line = line
            elif table_line:
                return table_line
            continue
        key = re.match(r'\s*"?(\w+)"?\s*[.=]', content)
        if key and (
            (not table and key[1] == keys[0]) or (table_line and len(keys) > 1 and key[1] == keys[1])
        ):
            return line + _lines_before_item(text.splitlines()[line - 1 :], parts[-1][1])
    return table_line


def _lines_before_item(lines: list[str], number: str) -> int:
    """Return how many lines a list takes before its item of a number; 0 if there is no such item."""
    for count in range(1, len(lines) + 1) if number else ():
        for end in ("", "\n]"):
            try:
                (items,) = tomllib.loads("\n".join(lines[:count]) + end).values()
            except ValueError:
                continue
            has_item = isinstance(items, list) and len(items) > int(number)
            if has_item or not end:
                return count - 1 if has_item else 0
    return 0


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]
