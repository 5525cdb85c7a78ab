"""The processes that move a robot are killed and stopped: it is held, and motion does not restart by itself."""

import random

import pytest
import trials_of_robot
from trials import BrokenPromise
from trials_of_robot import ENDS, robot_processes

CASES = [(who, how) for who in ("program", "process") for how in ENDS]


class Chosen(random.Random):
    """Draws a given fault, and random times."""

    def __init__(self, seed: int, who: str, how: str) -> None:
        super().__init__(seed)
        self._left = [who, how]

    def choice(self, options):
        return self._left.pop(0)


@pytest.mark.parametrize("who, how", CASES, ids=lambda each: each)
def test_the_robot_is_held(who, how, tmp_path):
    measured = robot_processes(Chosen(1, who, how), tmp_path)
    assert measured.what.startswith(how)
    assert measured.silence_ms is not None


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_the_robot_is_held_whenever_it_happens(seed, tmp_path):
    robot_processes(random.Random(f"robot {seed}"), tmp_path)


def test_a_robot_that_moves_on_breaks_the_promise(tmp_path, monkeypatch):
    monkeypatch.setattr(trials_of_robot, "HELD_MS", -trials_of_robot.SHARED_MS - 10_000)
    with pytest.raises(BrokenPromise, match="held after"):
        robot_processes(Chosen(2, "program", "SIGSTOP"), tmp_path)
