"""Promised motions, made by the simulated needle and compared with all motions of a fine grid."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
from moved_needles import EYES, Moment, simulated_moments, states_after

from haptigraph.assemble import load_procedure
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.motion.search import MotionSearch
from haptigraph.proof.motion.sweep import Sweep
from haptigraph.scene.builder import SchemaSceneBuilder

PROCEDURES = (
    "subretinal_injection",
    "subretinal_injection_steady",  # with hysteresis
    "subretinal_injection_cautious",  # with margins
    "subretinal_injection_phases",
)


@cache
def procedure_of(name: str) -> Procedure:
    return load_procedure(name)


def count_kept(name: str, every: int, one_in: int = 1) -> tuple[int, list[str]]:
    """Return the number of promises, and those that the simulated needle does not keep."""
    procedure, promised, broken = procedure_of(name), 0, []
    for moment in list(simulated_moments(procedure, every))[::one_in]:
        for motion in MotionSearch(procedure, moment.needle, moment.graph).motions():
            promised += 1
            reached = states_after(moment, motion, procedure)
            if reached[-1] != motion.state or not set(motion.alarms) <= set(reached):
                broken.append(f"{moment.pose} {motion}: {reached}")
    return promised, broken


@pytest.mark.parametrize("name", PROCEDURES)
def test_the_simulated_needle_reaches_every_promised_state(name):
    promised, broken = count_kept(name, 300, one_in=5)
    assert promised >= 12
    assert not broken, broken[0]


@pytest.mark.slow
def test_500_counterfactuals_are_true_as_motions():
    results = [count_kept(name, 100) for name in PROCEDURES]
    assert sum(promised for promised, _ in results) >= 500
    broken = [one for _, each in results for one in each]
    assert not broken, f"{len(broken)}, for instance {broken[0]}"


def compared_with_grid(moment: Moment, procedure: Procedure) -> Counter[str]:
    """Count states that a motion of the fine grid leads to, promised ones, and promised lengths within 20 %."""
    needle, sweep = moment.needle, Sweep(procedure, moment.needle, moment.graph)
    shortest: dict[str, float] = {}
    for turn_end in needle.turn_range_deg:
        turn = np.arange(0, abs(turn_end), 0.1)[:, None] * np.sign(turn_end)
        turned = sweep.along(turn, np.zeros((1, 1)))
        held = {names: edges[:, 0] for names, edges in turned.edges.items()}
        for advance_end in needle.advance_range_mm:
            advance = np.arange(0, abs(advance_end), 0.1)[:, None] * np.sign(advance_end)
            rules = sweep.along(turn.T, advance, held).rules
            length = np.abs(advance) + np.abs(turn.T) * needle.mm_per_deg
            for rule in np.unique(rules):
                state = procedure.states[rule].name
                least = float(length[rules == rule].min())
                shortest[state] = min(least, shortest.get(state, np.inf))
    promised: dict[str, float] = {}
    for motion in MotionSearch(procedure, needle, moment.graph).motions():
        promised[motion.state] = min(motion.length_mm, promised.get(motion.state, np.inf))
    del shortest[RuleEngine(without_time(procedure))(moment.graph).state]
    return Counter(
        {
            "possible": len(shortest),
            "promised": len(shortest.keys() & promised.keys()),
            "short": sum(promised.get(state, np.inf) <= 1.2 * least for state, least in shortest.items()),
        }
    )


def test_what_a_fine_grid_finds_is_promised_as_short():
    procedure = procedure_of("subretinal_injection_steady")
    moment = next(simulated_moments(procedure, 400))
    counts = compared_with_grid(moment, procedure)
    assert counts["possible"] >= 5
    assert counts["promised"] == counts["short"] == counts["possible"]


@pytest.mark.slow
@pytest.mark.parametrize("name", PROCEDURES)
def test_what_a_fine_grid_finds_is_nearly_always_promised(name):
    procedure = procedure_of(name)
    moments = simulated_moments(procedure, 300)
    counts = sum((compared_with_grid(moment, procedure) for moment in moments), Counter())
    assert counts["possible"] >= 60
    assert counts["promised"] >= 0.95 * counts["possible"]
    assert counts["short"] >= 0.95 * counts["possible"]


@pytest.mark.parametrize("name", PROCEDURES)
def test_the_sweep_agrees_with_builder_and_rules(name):
    procedure, rng = procedure_of(name), np.random.default_rng(1)
    for moment in list(simulated_moments(procedure, 400))[:: len(EYES)]:
        sweep = Sweep(procedure, moment.needle, moment.graph)
        path = np.cumsum(rng.normal(0, (0.4, 0.3), (200, 2)), axis=0)
        rules = sweep.along(path[:, :1], path[:, 1:]).rules[:, 0]
        builder = SchemaSceneBuilder(procedure.schema)
        builder.resume(moment.graph)
        engine = RuleEngine(without_time(procedure))
        for rule, pose in zip(rules, path.tolist(), strict=True):
            assert engine(builder(moment.needle.moved(*pose))).priority == rule
