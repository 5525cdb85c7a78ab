"""Run, process and device fail while a hand is pushed: it is let go within the limits of docs/explanation/safety.md."""

import random

import pytest
import trials_of_force
from helpers import mostly_slow
from trials import BrokenPromise
from trials_of_force import CASES, forced_hand


class Chosen(random.Random):
    """Draws a given fault, and random times."""

    def __init__(self, seed, case):
        super().__init__(seed)
        self._case = case

    def choice(self, options):
        return self._case


LIKE_OTHERS = (  # a signal as strong as SIGKILL, and further impossible measurements
    *(("run", "SIGTERM"), ("process", "SIGTERM")),
    *(("device", "freeze"), ("device", "jump"), ("device", "speed")),
)


@pytest.mark.parametrize("case", mostly_slow(CASES, *(set(CASES) - set(LIKE_OTHERS))), ids=" ".join)
def test_the_hand_is_let_go(case, tmp_path):
    measured = forced_hand(Chosen(1, case), tmp_path)
    assert measured.what == f"{case[1]} of the {case[0]}"
    assert measured.silence_ms is not None


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(65))
def test_the_hand_is_let_go_whenever_it_happens(seed, tmp_path):
    forced_hand(random.Random(f"force {seed}"), tmp_path)


def test_a_hand_that_is_let_go_too_late_breaks_the_promise(tmp_path, monkeypatch):
    monkeypatch.setitem(trials_of_force.LIMITS_MS, ("run", "SIGKILL"), -trials_of_force.SHARED_MS - 100_000)
    with pytest.raises(BrokenPromise, match="let go after"):
        forced_hand(Chosen(2, ("run", "SIGKILL")), tmp_path)
