import subprocess
import sys

import pytest

from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import RobotConfig
from haptigraph.errors import BadInput
from haptigraph.run_robot import open_readings
from haptigraph.stages import Source

SETUP = """
[rcm]
at_mm = [0.0, 0.0, 0.0]
[eye]
translation_mm = [1.0, 0.0, 0.0]
quaternion = [0.0, 0.0, 0.0, 1.0]
tip_sd_mm = 0.2
"""


class NoSource(Source):
    rate_hz, is_live = 30.0, True


def test_a_run_without_a_robot_does_not_load_what_reads_one():
    """Start-up would wait for it."""
    program = (
        "import sys; from haptigraph.assemble import build; from haptigraph.config import load_config; "
        "build(load_config(None, ['source.uri=phantom:align_then_approach', 'run.realtime=false'])).close(); "
        "sys.exit('haptigraph.robot.process' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    "config, clock, own, problem",
    [
        (RobotConfig(setup="robot.toml"), MonotonicClock(), None, "goes with robot.uri"),
        (RobotConfig("crtk:PSM1"), VirtualClock(), None, "works in real time"),
        (RobotConfig("crtk:PSM1"), MonotonicClock(), SETUP, "readings of its own"),
        (RobotConfig("none:PSM1"), MonotonicClock(), None, "unknown robot"),
    ],
)
def test_what_cannot_be_read_is_refused(config, clock, own, problem):
    source = NoSource()
    source.robot_setup = own
    with pytest.raises(BadInput, match=problem):
        open_readings(config, source, clock)
