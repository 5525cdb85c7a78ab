import msgspec
import pytest

from haptigraph.errors import BadInput
from haptigraph.robot.check_report import CheckReport, checked, report_path
from haptigraph.version import __version__

URI = "crtk:PSM1"
PASSED = CheckReport(URI, True, "2026-01-02T03:04:05Z", __version__)


@pytest.fixture
def setup_path(tmp_path):
    return tmp_path / "robot.toml"


def test_a_robot_that_passed_its_check_is_accepted(setup_path):
    report_path(setup_path).write_bytes(msgspec.json.encode({**msgspec.to_builtins(PASSED), "findings": []}))
    checked(URI, setup_path)


def test_a_simulated_robot_needs_no_check(setup_path):
    checked("simulated:3", setup_path)


@pytest.mark.parametrize(
    "content, problem",
    [
        (None, "has not been checked; run haptigraph robot check crtk:PSM1"),
        (b"{", "is not a report"),
        (b'{"uri": "crtk:PSM1", "utc": "", "software_version": ""}', "is not a report"),
        (msgspec.json.encode(msgspec.structs.replace(PASSED, uri="crtk:PSM2")), "is about crtk:PSM2"),
        (
            msgspec.json.encode(msgspec.structs.replace(PASSED, passed=False)),
            "did not pass its check of 2026",
        ),
        (
            msgspec.json.encode(msgspec.structs.replace(PASSED, software_version="0.0.1")),
            "is of haptigraph 0.0.1",
        ),
    ],
)
def test_without_a_passed_check_of_this_interface_nothing_moves(setup_path, content, problem):
    if content is not None:
        report_path(setup_path).write_bytes(content)
    with pytest.raises(BadInput, match=problem):
        checked(URI, setup_path)
