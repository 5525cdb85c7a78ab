import pytest
from robot_recordings import record

from haptigraph.sim.robot.readings import ReadingsShape


@pytest.fixture(scope="session")
def late_run(tmp_path_factory):
    """A recording whose robot stamps its poses 120 ms late."""
    path = tmp_path_factory.mktemp("robot") / "late.mcap"
    record(path, ReadingsShape(stamps_late_ms=120.0))
    return path


@pytest.fixture(scope="session")
def aligned_run(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "aligned.mcap"
    record(path, ReadingsShape())
    return path
