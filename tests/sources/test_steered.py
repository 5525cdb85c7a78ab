"""The teleoperated phantom, as a source alone and in the whole loop."""

import math
import re
import threading
from itertools import islice

import numpy as np
import pytest
from helpers import mostly_slow
from mcap.reader import make_reader
from msgspec import Struct
from paths import DATA, ROOT

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import replay
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec, norm, subtract, unit
from haptigraph.messages import HandState, Step
from haptigraph.recording.reader import RunReader
from haptigraph.sim.robot.robot import JAWS_MAX_MM, JAWS_SPEED_MM_S
from haptigraph.sources.teleop import TeleopSource
from haptigraph.teleop.motion import HandMotion, TeleopSettings

SCALE = 0.2  # of the scenario's robot
PEELED = str(DATA / "peeled.toml")


@pytest.fixture(scope="module")
def name(quick) -> str:
    return quick.replace("quick.toml", "steered.toml")


@pytest.fixture(scope="module")
def uri(name) -> str:
    return f"teleop:{name}"


def build(uri: str, *settings: str):
    return assemble.build(load_config(None, (f"source.uri={uri}", "run.realtime=false", *settings)))


def test_without_hand_motion_the_needle_stays_at_the_start_of_the_scenario(name):
    source = TeleopSource(name, VirtualClock())
    first, *others = [source.read(1.0) for _ in range(10)]
    assert first.truth.depth_mm == 8.0
    assert first.truth.theta_deg == pytest.approx(6.0)
    assert all(capture.truth == first.truth for capture in others)
    assert [capture.stamp_ns for capture in others[:2]] == [33_333_333, 66_666_667]
    assert not others[-1].hand.engaged


def test_an_image_shows_the_hand_motion_until_it_was_read(name):
    source = TeleopSource(name, VirtualClock())
    before = source.read(1.0)
    source.teleop.put(HandMotion(True, 1.0))
    after = source.read(1.0)
    assert after.truth.depth_mm == pytest.approx(before.truth.depth_mm + SCALE)
    assert after.hand.along_mm == 1.0
    assert np.abs(after.image.astype(int) - before.image).max() > 50


def test_an_image_shows_the_hand_motion_until_it_was_due(name):
    class LateHand(VirtualClock):
        def wait_until(self, stamp_ns):
            super().wait_until(stamp_ns)
            source.teleop.put(HandMotion(True, 1.0))

    source = TeleopSource(name, LateHand())
    source.read(1.0)
    moved_mm = [source.read(1.0).hand.along_mm for _ in range(3)]
    assert moved_mm == [2.0, 1.0, 1.0]  # the first image moves nothing


def test_overdue_images_are_skipped(name):
    clock = VirtualClock(start_ns=7)
    source = TeleopSource(name, clock)
    source.read(1.0)
    clock.wait_until(7 + 3_500_000_000 // 30)
    late, after = source.read(1.0), source.read(1.0)
    assert (late.index, late.stamp_ns) == (3, 7 + 3_500_000_000 // 30)
    assert (after.index, after.stamp_ns) == (4, 7 + 133_333_333)


def test_motion_before_the_first_image_appears_in_the_second(name):
    source = TeleopSource(name, VirtualClock())
    source.teleop.put(HandMotion(True, 1.0))
    assert source.read(1.0).truth.depth_mm == 8.0
    assert source.read(1.0).truth.depth_mm == pytest.approx(8.0 + SCALE)


def test_the_same_hand_motion_gives_the_same_images(name):
    first, second = TeleopSource(name, VirtualClock()), TeleopSource(name, VirtualClock())
    rng = np.random.default_rng(0)
    for number in range(20):
        if number == 10:
            first.teleop.settings = second.teleop.settings = TeleopSettings(0.5, True, 0.2)
        for along_mm, across_mm in rng.normal(0, 0.5, (number % 3, 2)).tolist():
            motion = HandMotion(number % 7 != 0, along_mm, across_mm)
            first.teleop.put(motion)
            second.teleop.put(motion)
        one, other = first.read(1.0), second.read(1.0)
        assert (one.stamp_ns, one.truth, one.hand) == (other.stamp_ns, other.truth, other.hand)
        assert np.array_equal(one.image, other.image)


def test_no_motion_is_lost_between_threads(name):
    source = TeleopSource(name, VirtualClock())

    def push():
        for _ in range(2000):
            source.teleop.put(HandMotion(True, 0.001))

    hands = [threading.Thread(target=push) for _ in range(4)]
    for hand in hands:
        hand.start()
    captures = [source.read(1.0) for _ in range(5)]
    for hand in hands:
        hand.join()
    captures.append(source.read(1.0))
    assert sum(capture.hand.along_mm for capture in captures) == pytest.approx(8.0)


@pytest.mark.parametrize("quality", [0, 95])
def test_hand_motion_appears_one_image_later_in_the_assembled_loop(uri, quality):
    loop = build(uri, f"source.jpeg_quality={quality}")
    pairs = zip(loop.steps(), range(6), strict=False)
    tips = []
    for step, number in pairs:
        if number == 2:
            loop.source.teleop.put(HandMotion(True, 3.0))
        tips.append(step.observation.found["needle_tip"].at_mm)
    loop.close()
    moved_mm = [math.dist(tips[n + 1], tips[n]) for n in range(5)]
    assert moved_mm[0] < 0.1
    assert moved_mm[1] < 0.1
    assert moved_mm[2] == pytest.approx(3 * SCALE, abs=0.1)  # put after image 2, visible in image 3


def test_a_scripted_phantom_cannot_be_steered(quick_uri):
    config = load_config(None, (f"source.uri={quick_uri}", "source.jpeg_quality=95"))
    source = assemble.open_source(config, VirtualClock())
    assert source.teleop is None
    source.close()


def test_the_default_scenario_is_steered_without_an_argument():
    config = load_config(None, ("source.uri=teleop",))
    assert assemble.is_realtime(config)
    source = assemble.open_source(config, VirtualClock())
    assert source.read(1.0).truth.depth_mm == -4.5
    source.close()


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (("source.uri=teleop:nothing",), "unknown scenario 'nothing'"),
        (("source.uri=teleop", "source.loop=true"), "source.loop works with phantom:SCENARIO only"),
    ],
)
def test_settings_that_do_not_allow_teleoperation_are_rejected(settings, problem):
    with pytest.raises(BadInput, match=problem):
        assemble.build(load_config(None, settings))


def test_a_rate_too_low_for_the_tremor_filter_is_rejected(quick):
    with pytest.raises(BadInput) as raised:
        TeleopSource(quick, VirtualClock())
    problem = "rate_hz 15 is too low to be steered; use at least 25"
    assert str(raised.value) == f"{quick}, scenario.rate_hz: {problem}"


def test_a_note_says_how_to_steer(uri, quick_uri):
    for source_uri, count in ((uri, 1), (quick_uri, 0)):
        loop = build(source_uri)
        loop.close()
        assert sum("haptigraph live" in note for note in loop.notes) == count


def test_the_program_in_the_docs_steers(name):
    text = (ROOT / "docs/how_to/teleoperation.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict = {}
    exec(program.replace("align_then_approach", name), names)
    assert names["teleop"].hand.along_mm == 0.5
    tip_mm = names["step"].observation.found["needle_tip"].at_mm
    rcm_mm = names["step"].observation.found["trocar"].at_mm
    assert math.dist(tip_mm, rcm_mm) == pytest.approx(8 + 89 * 0.1, abs=0.5)  # a fifth of 0.5 mm per image


# --- closed loop


def next_motion(step: Step, hand_mm: float) -> HandMotion:
    """Control the hand by the observation: turn towards the target first, then advance."""
    found = step.observation.found
    if "needle_tip" not in found:
        return HandMotion(True)
    tip_mm, line = found["needle_tip"].at_mm, found["needle_line"]
    shaft = unit(subtract(line.end_mm, line.start_mm))
    rcm_mm, target_mm = found["trocar"].at_mm, found["retina_target"].at_mm
    error_rad = angle_to(shaft, subtract(target_mm, rcm_mm))
    across_mm = error_rad * norm(subtract(tip_mm, rcm_mm))
    along_mm = hand_mm if abs(math.degrees(error_rad)) < 0.8 else 0.0
    return HandMotion(True, along_mm, min(max(across_mm, -hand_mm), hand_mm))


def angle_to(direction: Vec, path: Vec) -> float:
    """Return the angle from a direction to a path [rad], counter-clockwise."""
    cross = direction[0] * path[1] - direction[1] * path[0]
    return math.atan2(cross, direction[0] * path[0] + direction[1] * path[1])


def steer_to_the_target(uri: str, settings: TeleopSettings, *more: str) -> list[str]:
    """Steer until the state is target_hit, at most 400 images, and return the states in order."""
    loop = build(uri, "perception.alpha=1", *more)
    loop.source.teleop.settings = settings
    states: list[str] = []
    for step in islice(loop.steps(), 400):
        if states[-1:] != [step.conclusion.state]:
            states.append(step.conclusion.state)
        if states[-1] == "target_hit":
            break
        loop.source.teleop.put(next_motion(step, hand_mm=0.15 / settings.motion_scale))
    loop.close()
    return states


@pytest.mark.parametrize(
    "settings",
    mostly_slow(
        [TeleopSettings(0.2), TeleopSettings(1.0), TeleopSettings(0.2, True), TeleopSettings(0.2, True, 0.3)],
        TeleopSettings(0.2, True, 0.3),
    ),
    ids=["fifth", "whole", "filtered", "trembling"],
)
def test_steering_by_steps_alone_hits_the_target_without_touching_the_retina(uri, settings):
    assert steer_to_the_target(uri, settings) == [
        "misaligned_intraocular_navigation",
        "aligned_intraocular_navigation",
        "aligned_retinal_approach",
        "target_hit",
    ]


def peel(*more: str) -> list[str]:
    """Open the jaws, advance to the membrane's edge, close and pull; return the states in order."""
    loop = build(f"teleop:{PEELED}", "run.procedure=membrane_peeling", *more)
    steps, states = loop.steps(), []

    def hold(motion: HandMotion, is_done=lambda step: False, images: int = 200) -> None:
        for step in islice(steps, images):
            if states[-1:] != [step.conclusion.state]:
                states.append(step.conclusion.state)
            if is_done(step):
                return
            loop.source.teleop.put(motion)

    hold(HandMotion(True, apart_mm=0.5), lambda step: step.graph.measures["opening_mm"] > 1.2)
    hold(HandMotion(True, along_mm=0.5), lambda step: step.graph.measures["distance_to_edge_mm"] < 0.2)
    hold(HandMotion(True, apart_mm=-0.5), images=20)
    hold(HandMotion(True, along_mm=-0.5), lambda step: step.conclusion.state == "peeling")
    loop.close()
    return states


def test_steering_by_steps_alone_peels_a_membrane():
    expected = ["navigation", "open_approach", "edge_between_jaws", "grasped", "peeling"]
    assert [state for state in peel() if state in expected] == expected


def test_jaws_keep_the_robots_speed_limit_and_stop_when_the_clutch_is_released():
    source = TeleopSource(PEELED, VirtualClock())

    def opening_mm(*motions: HandMotion) -> float:
        for motion in motions:
            source.teleop.put(motion)
        places = source.read(1.0).truth.others
        return math.dist(places["left_jaw"].at_mm, places["right_jaw"].at_mm)

    shut_mm = opening_mm()
    opened_mm = [opening_mm(HandMotion(True, apart_mm=500.0)) for _ in range(45)]
    assert np.diff([0.0, *opened_mm]).max() <= JAWS_SPEED_MM_S / 30 + 0.01  # closed jaws lie side by side
    assert opened_mm[-1] == pytest.approx(JAWS_MAX_MM)
    closing_mm = opening_mm(HandMotion(True, apart_mm=-0.5))
    assert closing_mm == pytest.approx(JAWS_MAX_MM - SCALE * 0.5)  # nothing wound up at the limit
    assert opening_mm(HandMotion(True, apart_mm=-5.0), HandMotion(False)) == closing_mm
    assert [opening_mm() for _ in range(10)] == [closing_mm] * 10
    for _ in range(45):
        opening_mm(HandMotion(True, apart_mm=-5.0))
    assert opening_mm() == shut_mm


def test_a_needle_ignores_jaw_motion(name):
    source = TeleopSource(name, VirtualClock())
    first = source.read(1.0)
    source.teleop.put(HandMotion(True, apart_mm=5.0))
    after = source.read(1.0)
    assert after.truth == first.truth
    assert (after.hand.engaged, after.hand.apart_mm, after.hand.asked_apart_mm) == (True, 0.0, 0.0)


# --- recording


def test_jaw_motion_is_recorded_and_the_replay_is_identical(tmp_path):
    path = tmp_path / "peeled.mcap"
    assert peel(f'recording.path="{path}"')[-1] == "peeling"
    hands = [capture.hand for capture, _ in RunReader(path).records(images=())]
    assert {hand.apart_mm for hand in hands} == {0.0, 0.5, -0.5}
    assert {hand.asked_apart_mm for hand in hands} == {0.0, 0.1, -0.1}
    report = replay(path)
    assert report.identical == report.steps == len(hands)


def test_a_recording_without_jaw_motion_is_read_and_replayed(uri, tmp_path, monkeypatch):
    class HandBeforeJaws(Struct):
        engaged: bool
        along_mm: float
        across_mm: float
        asked_along_mm: float
        asked_across_mm: float
        motion_scale: float
        tremor_filter: bool
        added_tremor_mm: float

    def before_jaws(**fields) -> HandBeforeJaws:
        return HandBeforeJaws(*(fields[name] for name in HandBeforeJaws.__struct_fields__))

    path = tmp_path / "old.mcap"
    monkeypatch.setattr("haptigraph.teleop.mapping.HandState", before_jaws)
    steer_to_the_target(uri, TeleopSettings(), f'recording.path="{path}"')
    with path.open("rb") as file:
        data = next(message.data for _, _, message in make_reader(file).iter_messages(["/teleop"]))
    assert b"asked_across_mm" in data and b"apart_mm" not in data
    captures = [capture for capture, _ in RunReader(path).records(images=())]
    assert {(type(capture.hand), capture.hand.apart_mm) for capture in captures} == {(HandState, 0.0)}
    report = replay(path)
    assert report.identical == report.steps == len(captures)


def test_hand_motion_is_recorded_and_the_replay_is_identical(uri, tmp_path):
    path = tmp_path / "steered.mcap"
    states = steer_to_the_target(uri, TeleopSettings(0.2, True, 0.1), f'recording.path="{path}"')
    assert states[-1] == "target_hit"
    captures = [capture for capture, _ in RunReader(path).records(images=())]
    hands = [capture.hand for capture in captures if capture.hand is not None]
    assert len(hands) == len(captures) > 50
    assert [hand.engaged for hand in hands] == [False] + [True] * (len(hands) - 1)
    assert {(hand.motion_scale, hand.tremor_filter, hand.added_tremor_mm) for hand in hands[1:]} == {
        (0.2, True, 0.1)
    }
    assert max(hand.along_mm for hand in hands) == pytest.approx(0.75)
    asked_mm = sum(hand.asked_along_mm for hand in hands)
    assert captures[-1].truth.depth_mm == pytest.approx(captures[0].truth.depth_mm + asked_mm)
    report = replay(path)
    assert report.identical == report.steps == len(captures)


def test_recordings_without_teleoperation_have_no_hand_motion(quick_uri, tmp_path):
    path = tmp_path / "scripted.mcap"
    loop = build(quick_uri, f'recording.path="{path}"')
    for _ in islice(loop.steps(), 5):
        pass
    loop.close()
    assert [capture.hand for capture, _ in RunReader(path).records(images=())] == [None] * 5
    with path.open("rb") as file:
        assert "/teleop" not in {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
