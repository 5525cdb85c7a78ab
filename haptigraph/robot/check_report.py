"""The report of `haptigraph robot check`, beside robot.toml: without a passed one no robot moves."""

from pathlib import Path

import msgspec
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.version import __version__

__all__ = ["REPORT_NAME", "CheckReport", "checked", "report_path"]

REPORT_NAME = "robot_check.json"


class CheckReport(Struct, frozen=True):
    """What decides whether a robot may move; the file may contain more."""

    uri: str
    """The robot, as it is opened."""
    passed: bool
    utc: str
    """When it was checked: ISO 8601."""
    software_version: str


def report_path(setup_path: str | Path) -> Path:
    """Return the path of the report that belongs to a robot.toml."""
    return Path(setup_path).with_name(REPORT_NAME)


def checked(uri: str, setup_path: str | Path) -> None:
    """Refuse a robot whose interface has not passed its check; a simulated robot needs none.

    Args:
        uri: The robot, as it is opened.
        setup_path: Its robot.toml.

    Raises:
        BadInput: If the report is absent or damaged, or is about another robot or other software, or failed.
    """
    if uri.partition(":")[0] == "simulated":
        return
    path = report_path(setup_path)
    remedy = f"run haptigraph robot check {uri} --setup {setup_path}"
    try:
        report = msgspec.json.decode(path.read_bytes(), type=CheckReport)
    except FileNotFoundError:
        raise BadInput(f"{uri} has not been checked; {remedy}") from None
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except msgspec.MsgspecError as error:
        raise BadInput(f"is not a report of robot check ({error}); {remedy}", path) from None
    if report.uri != uri:
        raise BadInput(f"is about {report.uri}, not {uri}; {remedy}", path)
    if report.software_version != __version__:
        raise BadInput(f"is of haptigraph {report.software_version}, this is {__version__}; {remedy}", path)
    if not report.passed:
        raise BadInput(
            f"{uri} did not pass its check of {report.utc}; correct what it reports, then {remedy}", path
        )
