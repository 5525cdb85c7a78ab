"""Moments of simulated runs, and the simulated needle that makes a promised motion."""

from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Phase, Point, Segment, Vec
from haptigraph.graph import SceneGraph
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Certainty, Observation
from haptigraph.proof.motion.needle import Needle, needle_of
from haptigraph.proof.motion.search import Motion
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import Scenario, load_scenario

EYES = ((24.0, 9.0, 36.0), (24.0, -20.0, 36.0), (19.0, 0.0, 30.0), (29.0, 25.0, 45.0))
"""Diameter [mm], position of the target and of the trocar [deg]."""
SCENARIOS = {
    "align_then_approach": "injection",
    "misaligned_then_correct": "withdrawal",
    "wrong_place_then_hit": "approach",
}
"""And the phase in which each is played, for procedures with phases."""
LIMITS = RobotLimits(depth_max_mm=60.0)  # larger eyes are deeper
STEP_S = 0.0025  # the robot moves 0.05 mm or 0.075 degrees in it


class Moment(Struct, frozen=True, eq=False):
    """A moment of a simulated run, by the truth."""

    registration: Registration
    needle: Needle
    graph: SceneGraph
    pose: Pose
    phase: str


def observed(registration: Registration, tip_mm: Vec, phase: str) -> Observation:
    """The true needle, as precisely as the tracker sees it."""
    found = {"needle_tip": Point(tip_mm), "needle_line": Segment(registration.trocar.at_mm, tip_mm)}
    found |= {phase: Phase(1.0)}
    return Observation(0, registration.anatomy | found, certainty=Certainty(1.0, 0.02, 0.05))


def simulated_moments(procedure: Procedure, every: int) -> Iterator[Moment]:
    """Play scenarios in several eyes, and yield some of their images with a needle in the eye."""
    for diameter_mm, target_deg, trocar_deg in EYES:
        for name, phase in SCENARIOS.items():
            scenario = load_scenario(name)
            shape = {"diameter_mm": diameter_mm, "target_deg": target_deg, "trocar_deg": trocar_deg}
            yield from _played(replace(scenario, eye=replace(scenario.eye, **shape)), procedure, every, phase)


def _played(scenario: Scenario, procedure: Procedure, every: int, phase: str) -> Iterator[Moment]:
    phantom = Phantom(scenario)
    registration = parse_registration(phantom.true_registration, "simulated")
    robot = Robot(registration.trocar.at_mm, LIMITS, Pose(0.0, 0.0))
    builder, number = SchemaSceneBuilder(procedure.schema), 0
    while (moment := phantom.advance(draws=False)) is not None:
        truth, number = moment.truth, number + 1
        if not truth.visible or truth.depth_mm < 1:
            continue
        observation = observed(registration, truth.tip_mm, phase)
        graph = builder(observation)
        if number % every == 0:
            needle = needle_of(observation)
            assert needle is not None
            pose = Pose(truth.depth_mm, robot.pitch_towards(truth.tip_mm))
            yield Moment(registration, needle, graph, pose, phase)


def states_after(moment: Moment, motion: Motion, procedure: Procedure) -> list[str]:
    """Let the simulated robot make a motion, and return the states that follow, without repetitions."""
    robot = Robot(moment.registration.trocar.at_mm, LIMITS, moment.pose)
    turned = Pose(moment.pose.depth_mm, moment.pose.pitch_deg + motion.turn_deg)
    ended = Pose(turned.depth_mm + motion.advance_mm, turned.pitch_deg)
    builder = SchemaSceneBuilder(procedure.schema)
    builder.resume(moment.graph)
    states: list[str] = []
    for target in (turned, ended):
        while robot.pose != target:
            before = robot.pose
            robot.follow(target, STEP_S)
            assert robot.pose != before, f"the robot's limits prevent {motion}"
            graph = builder(observed(moment.registration, robot.tip_mm(), moment.phase))
            state = RuleEngine(without_time(procedure))(graph).state
            if not states or state != states[-1]:
                states.append(state)
    return states
