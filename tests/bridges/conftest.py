import socket

import pytest

from haptigraph.assemble import load_procedure
from haptigraph.bridges.bridge import RunContext
from haptigraph.clock import MonotonicClock
from haptigraph.recording.schema import RunInfo


@pytest.fixture
def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@pytest.fixture
def run(registration):
    """The context of a run whose source cannot be steered."""
    procedure = load_procedure("subretinal_injection")
    info = RunInfo(
        "0",
        "2026-01-01T00:00:00+00:00",
        10**18,
        "test",
        30.0,
        "{}",
        registration.text,
        registration.sha256,
        procedure.text,
        procedure.sha256,
    )
    measures = ("theta_deg", "distance_to_retina_mm")
    return RunContext(info, registration.image, measures, MonotonicClock(), None)
