"""Simulated participants with the actual pipeline."""

import math
import pickle

import pytest
from msgspec.structs import replace
from touch_trials import play_trial

from haptigraph.analysis.metrics.run import RunMeasures, measure_run
from haptigraph.geometry import distance_to_polyline
from haptigraph.graph import Triplet
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import RunInfo
from haptigraph.recording.writer import RunWriter
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.tissue import TissueShape
from haptigraph.sinks.recorder import Recorder
from haptigraph.study.simulated.participant import draw_participant
from haptigraph.study.simulated.rehearsal import NO_TOUCH, SHIPPED, Rehearsal, draw_scenario

SEED = (3, 8, 0, 0)
BINARY = SHIPPED[1]
SMALL = CameraSettings(width_px=480, height_px=270, center_px=(240.0, 148.0), px_per_mm=8.0, blur_px=0.5)
INDEPENDENT = ("participant", "repetition", "hit", "theta_deg", "completion_s", "contacts", "far_aligned_s")


@pytest.fixture(scope="module")
def participant():
    return replace(draw_participant(3, 0), align_share=0.2)


@pytest.fixture(scope="module")
def trials(participant):
    return {condition.name: play_trial(participant, condition, 0, 3) for condition in SHIPPED}


def test_steps_depend_on_the_seed_only(participant):
    def first_steps(seed):
        steps = Rehearsal(participant, BINARY, draw_scenario(seed), seed).steps()
        first = [replace(next(steps), timing=None) for _ in range(90)]
        steps.close()
        return first

    assert first_steps(SEED) == first_steps(SEED)
    assert first_steps(SEED) != first_steps((4, 8, 0, 0))


def test_a_trial_can_be_simulated_in_another_process(participant, trials):
    args = pickle.loads(pickle.dumps((participant, BINARY, 0, 3)))
    assert play_trial(*args) == pickle.loads(pickle.dumps(trials["binary"]))


def test_every_trial_ends_at_the_target_with_plausible_measures(trials):
    for trial in trials.values():
        assert trial.hit
        assert 5 < trial.completion_s < 120
        assert 0 < trial.theta_deg < 30


def test_haptic_feedback_improves_alignment_before_the_approach(trials):
    for condition in ("binary", "continuous"):
        assert trials[condition].theta_deg < trials["no touch"].theta_deg
        assert trials[condition].far_aligned_s > trials["no touch"].far_aligned_s
        assert 0 < trials[condition].vibrating_s < trials[condition].completion_s
        assert trials[condition].changes_per_min > 0


def test_without_haptics_nothing_vibrates(trials):
    assert trials["no touch"].vibrating_s == trials["no touch"].changes_per_min == 0


def test_a_participant_who_feels_nothing_moves_equally_in_all_conditions(participant):
    numb = replace(participant, absolute_threshold=2.0)
    rows = [play_trial(numb, condition, 0, 3) for condition in SHIPPED]
    assert len({tuple(getattr(row, name) for name in INDEPENDENT) for row in rows}) == 1
    assert rows[1].vibrating_s > 0  # although the device vibrates


def test_the_needle_enters_perpendicular_to_the_wall(participant):
    for number in range(20):
        rehearsal = Rehearsal(participant, NO_TOUCH, draw_scenario((number,)), (number,))
        truth = rehearsal.loop.source.read(0.1).truth
        rehearsal.loop.close()
        trocar_mm = rehearsal.registration.trocar.at_mm
        along = math.hypot(*trocar_mm) * math.dist(truth.tip_mm, trocar_mm)
        inwards = -sum(a * (b - a) for a, b in zip(trocar_mm, truth.tip_mm, strict=True))
        assert inwards == pytest.approx(along)
        assert truth.inside


def test_the_retina_can_be_deformed_by_a_simulated_hand(participant):
    scenario = draw_scenario(SEED)
    eye = replace(scenario.eye, retina_mm=1.2)
    soft = replace(scenario, eye=eye, tissue=TissueShape(puncture_mm=0.8))
    rehearsal = Rehearsal(participant, NO_TOUCH, soft, SEED)
    truths = [rehearsal.loop.source.read(0.1).truth for _ in range(600)]
    rehearsal.loop.close()
    pressed = [truth for truth in truths if truth.inside and math.hypot(*truth.tip_mm) > 10.85]
    assert pressed
    for truth in pressed:
        assert distance_to_polyline(truth.tip_mm, truth.others["retina_surface"]) < 0.01


def test_the_tracker_works_on_rendered_images_and_the_recording_has_the_same_measures(participant, tmp_path):
    scenario = replace(draw_scenario(SEED), camera=SMALL)
    rehearsal = Rehearsal(participant, BINARY, scenario, SEED, perceiver="tracker")
    path = tmp_path / "trial.mcap"
    info = RunInfo(
        version="0",
        started_utc="",
        utc_offset_ns=0,
        source="simulated",
        rate_hz=30.0,
        config="{}",
        registration=rehearsal.registration.text,
        registration_sha256=rehearsal.registration.sha256,
        procedure=rehearsal.procedure.text,
        procedure_sha256=rehearsal.procedure.sha256,
        participant="simulated",
        trial="0",
    )
    writer = RunWriter(path, info, rehearsal.registration.image, ("theta_deg",))
    rehearsal.loop.sinks = (Recorder(writer, waits=True),)
    live = RunMeasures.under(rehearsal.procedure)
    for number, step in enumerate(rehearsal.steps()):
        live.add(step)
        if number == 240:
            break
    rehearsal.loop.close()
    recorded = measure_run(step for _, step in RunReader(path).records(images=()))
    assert Triplet("needle_tip", "inside", "eye_globe") in recorded.last.graph
    assert recorded.is_running and live.is_running
    for name in ("started_ns", "state_s", "order", "contacts", "mean_theta_deg"):
        assert getattr(recorded, name) == getattr(live, name)
