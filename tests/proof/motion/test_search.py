"""Promised motions, made by the simulated needle and compared with all motions of a fine grid."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
from helpers import mostly_slow
from moved_needles import EYES, Moment, simulated_moments, states_after
from msgspec.structs import replace
from paths import GOLDEN

from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.geometry import Point, norm, subtract
from haptigraph.graph import SceneGraph
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.motion.needle import Needle, needle_of
from haptigraph.proof.motion.search import MotionSearch
from haptigraph.proof.motion.sweep import Sweep
from haptigraph.recording.reader import RunReader
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


@pytest.mark.parametrize("name", PROCEDURES[1:2])
def test_the_simulated_needle_reaches_every_promised_state(name):
    promised, broken = count_kept(name, 300, one_in=8)
    assert promised >= 12
    assert not broken, broken[0]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_500_counterfactuals_are_true_as_motions():
    results = [count_kept(name, 200) for name in PROCEDURES]
    assert sum(promised for promised, _ in results) >= 500
    broken = [one for _, each in results for one in each]
    assert not broken, f"{len(broken)}, for instance {broken[0]}"


def compared_with_grid(moment: Moment, procedure: Procedure) -> Counter[str]:
    """Count states that a motion of the fine grid leads to, promised ones, and promised lengths within 20 %."""
    needle, sweep = moment.needle, Sweep(procedure, moment.needle, moment.graph)
    shortest: dict[str, float] = {}
    for turn_end in needle.turn_range_deg:
        turn = np.arange(0, abs(turn_end) + 1e-9, 0.1)[:, None] * np.sign(turn_end)
        turned = sweep.along(turn, np.zeros((1, 1)))
        held = {names: edges[:, 0] for names, edges in turned.edges.items()}
        for advance_end in needle.advance_range_mm:
            advance = np.arange(0, abs(advance_end) + 1e-9, 0.1)[:, None] * np.sign(advance_end)
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
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", PROCEDURES)
def test_what_a_fine_grid_finds_is_nearly_always_promised(name):
    procedure = procedure_of(name)
    moments = simulated_moments(procedure, 300)
    counts = sum((compared_with_grid(moment, procedure) for moment in moments), Counter())
    assert counts["possible"] >= 60
    assert counts["promised"] >= 0.95 * counts["possible"]
    assert counts["short"] >= 0.95 * counts["possible"]


@pytest.mark.parametrize("name", mostly_slow(PROCEDURES, "subretinal_injection_cautious"))
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


@cache
def injecting() -> tuple[Procedure, Needle, SceneGraph]:
    """The moment of a recorded run at which the needle is in the target."""
    reader = RunReader(GOLDEN / "injection_with_phases.mcap")
    step = next(one for _, one in reader.places() if one.conclusion.state == "injecting")
    needle = needle_of(step.observation)
    assert needle is not None
    return parse_procedure(reader.info.procedure, "recorded"), needle, step.graph


def test_a_motion_without_alarm_is_advised_before_a_shorter_one():
    motions = [one for one in MotionSearch(*injecting()).motions() if one.state == "outside_eye"]
    advised, shorter = motions
    assert advised.advance_mm < -10 and not advised.alarms and not advised.pierces
    assert shorter.length_mm < advised.length_mm
    assert shorter.pierces and "retinal_contact" in shorter.alarms


def test_lengths_are_the_way_of_the_tip():
    _, needle, _ = injecting()
    for motion in MotionSearch(*injecting()).motions():
        turned = needle.moved(motion.turn_deg, 0.0).found["needle_tip"].at_mm
        ended = needle.moved(motion.turn_deg, motion.advance_mm).found["needle_tip"].at_mm
        chord_mm = norm(subtract(turned, needle.tip_mm))
        arc_mm = np.radians(abs(motion.turn_deg)) * norm(subtract(needle.tip_mm, needle.trocar_mm))
        assert chord_mm <= arc_mm + 1e-9 < chord_mm + 0.2
        assert motion.length_mm == pytest.approx(arc_mm + norm(subtract(ended, turned)))


def test_another_target_leads_to_a_state():
    procedure = procedure_of("subretinal_injection")
    moment = next(
        one for one in simulated_moments(procedure, 10) if one.graph.measures["distance_to_retina_mm"] < 5
    )
    state = RuleEngine(procedure)(moment.graph).state
    other = {
        "misaligned_retinal_approach": "aligned_retinal_approach",
        "aligned_retinal_approach": "misaligned_retinal_approach",
    }[state]
    (motion,) = MotionSearch(procedure, moment.needle, moment.graph).with_target({other})
    found = moment.needle.observation.found | {"retina_target": Point(motion.target_mm)}
    builder = SchemaSceneBuilder(procedure.schema)
    assert RuleEngine(procedure)(builder(replace(moment.needle.observation, found=found))).state == other


def test_without_a_needle_there_is_nothing_to_move():
    _, needle, _ = injecting()
    found = {name: shape for name, shape in needle.observation.found.items() if name != "needle_tip"}
    assert needle_of(replace(needle.observation, found=found)) is None
