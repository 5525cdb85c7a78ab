import numpy as np
import pytest
from robot_runs import simulated_run

from haptigraph.errors import BadInput
from haptigraph.robot.place.pivot import fit_pivot


def test_the_shafts_meet_in_the_pivot():
    run = simulated_run(np.random.default_rng(1), seconds=10)
    pivot = fit_pivot(run.robot_mm[::5], run.robot_axes[::5], "run")
    assert np.abs(pivot.at_mm - run.rcm_mm).max() < 4 * pivot.sd_mm < 0.1
    assert 0.005 < pivot.rms_mm < 0.05


def test_a_shaft_that_does_not_turn_and_one_that_does_not_pivot_are_refused():
    tips_mm, along = np.linspace((0.0, 0, 0), (0, 0, -9), 50), np.tile((0.0, 0.0, -1.0), (50, 1))
    with pytest.raises(BadInput, match=r"turns by only 0\.0°"):
        fit_pivot(tips_mm, along, "run")
    run = simulated_run(np.random.default_rng(2), seconds=10)
    with pytest.raises(BadInput, match="do not meet"):
        fit_pivot(run.robot_mm[::5] * (1.0, 1.0, 1.5), run.robot_axes[::5], "run")
    with pytest.raises(BadInput, match="too few"):
        fit_pivot(run.robot_mm[:5], run.robot_axes[:5], "run")
