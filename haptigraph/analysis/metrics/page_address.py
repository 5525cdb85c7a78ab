"""The address of a moment of a recording on the recordings page."""

from pathlib import Path
from urllib.parse import quote, urlencode

__all__ = ["PAGE", "moment_address", "page_command", "page_procedure"]

PORT = 8765
PAGE = f"http://127.0.0.1:{PORT}"
"""Where `page_command` serves the page."""


def page_command(folder: str | Path) -> str:
    """Return the command that serves the page for a folder of recordings."""
    return f"haptigraph live --recordings {folder} --port {PORT}"


def moment_address(name: str, *, step: int | None = None, procedure: str = "", page: str = PAGE) -> str:
    """Return the address of a recording, of one step in it, and of its comparison with another procedure.

    Args:
        name: The recording, relative to the page's folder.
        step: The number of the step; None: the first.
        procedure: As `page_procedure` returns it; empty: no comparison.
        page: Address of the server.
    """
    given = {"step": str(step)} if step is not None else {}
    given |= {"with": procedure} if procedure else {}
    return f"{page.rstrip('/')}/recordings#{quote(name, safe='')}{'?' if given else ''}{urlencode(given)}"


def page_procedure(name: str, folder: Path) -> str:
    """Return the name by which the page knows a procedure.

    Args:
        name: Of a shipped procedure, or of a file.
        folder: The page's folder.

    Returns:
        the name; empty if neither the file nor a copy of it, under its name, is in the folder.
    """
    if not name.endswith(".toml"):
        return name
    path = Path(name)
    if path.resolve().parent == folder.resolve():
        return path.name
    try:
        is_copied = (folder / path.name).read_bytes() == path.read_bytes()
    except OSError:
        is_copied = False
    return path.name if is_copied else ""
