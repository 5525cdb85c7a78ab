import numpy as np
import pytest
from helpers import LOW, call
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.analysis.metrics.run import measure_run
from haptigraph.analysis.metrics.trial import measure_recording, measure_trial
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.graph import SceneGraph, Triplet
from haptigraph.messages import OFF, Conclusion, HapticCommand, Observation, Step
from haptigraph.recording.reader import RunReader
from haptigraph.study.data_dictionary import MEASURES, check_measures

QUALITY = {
    *("images_per_s", "late_images_fraction", "skipped_images"),
    *("unseen_fraction", "long_gaps", "longest_gap_s"),
}
INSIDE = Triplet("needle_tip", "inside", "eye_globe")
NEAR = Triplet("needle_tip", "approaching", "retina_surface")
RATE_HZ = 30


def steps_of(
    seconds,
    theta_deg,
    *,
    tip_mm=None,
    near=lambda s: False,
    cue=lambda s: False,
    detected=lambda s: True,
    hit=True,
    rate_hz=RATE_HZ,
):
    """Steps of a run of some duration, described by functions of time."""
    made, since_ns, pattern = [], 0, OFF
    count = round(seconds * rate_hz)
    for number in range(count + 1):
        s = number / rate_hz
        stamp_ns = round(s * 1e9)
        wanted = LOW if cue(s) else OFF
        if wanted != pattern:
            pattern, since_ns = wanted, stamp_ns
        at_mm = tip_mm(s) if tip_mm else (0.0, -s)
        found = {"needle_tip": Point(at_mm)} if detected(s) else {}
        measures = {"theta_deg": theta_deg(s), "distance_to_retina_mm": 12 + at_mm[1]} if detected(s) else {}
        edges = (INSIDE, NEAR) if near(s) else (INSIDE,)
        state = "target_hit" if hit and number == count else "navigating" if detected(s) else "unknown"
        made.append(
            Step(
                number,
                stamp_ns,
                Observation(stamp_ns, found),
                SceneGraph(stamp_ns, (), edges, measures),
                Conclusion(stamp_ns, state, 1, pattern.name, "because"),
                HapticCommand(stamp_ns, pattern, since_ns),
            )
        )
    return made


def test_a_uniform_run_has_the_expected_measures():
    measures = measure_trial(steps_of(8, lambda s: 2.0), ["navigating", "retinal_contact"])
    assert measures["completion_s"] == pytest.approx(8.0)
    assert measures["mean_theta_deg"] == pytest.approx(2.0)
    assert measures["path_mm"] == pytest.approx(8.0, rel=0.01)
    assert measures["time_navigating_s"] == pytest.approx(8.0)
    assert measures["time_retinal_contact_s"] == 0.0
    assert measures["contacts"] == 0
    assert measures["vibrating_s"] == 0.0
    assert measures["state_order"] == "navigating>target_hit"
    assert measures["tremor_power_mm2"] == pytest.approx(0.0, abs=1e-9)
    assert "reaction_ms" not in measures and "approach_speed_mm_s" not in measures


@pytest.mark.parametrize("delay_s", [0.2, 0.35, 0.8])
def test_the_reaction_to_a_cue_is_the_delay_of_its_correction(delay_s):
    def theta_deg(s):
        return 6.0 - 4.0 * np.clip(s - 3 - delay_s, 0, 1)

    measures = measure_trial(steps_of(6, theta_deg, cue=lambda s: s >= 3))
    assert measures["reaction_ms"] == pytest.approx(1000 * delay_s, abs=70)
    assert measures["vibrating_s"] == pytest.approx(3.0, abs=0.04)


@pytest.mark.parametrize("begins_s", [2.0, 3.02, 5.5])
def test_corrections_too_early_or_too_late_are_no_reactions(begins_s):
    theta = lambda s: 9.0 - 3.0 * np.clip(s - begins_s, 0, 2)  # noqa: E731
    assert "reaction_ms" not in measure_trial(steps_of(8, theta, cue=lambda s: s >= 3))


def test_without_haptic_output_nothing_vibrates_but_reactions_are_measured_alike():
    steps = steps_of(6, lambda s: 6.0 - 4.0 * np.clip(s - 3.4, 0, 1), cue=lambda s: s >= 3)
    on, off = measure_trial(steps), measure_trial(steps, has_haptics=False)
    assert off["vibrating_s"] == 0.0 < on["vibrating_s"]
    assert off["reaction_ms"] == on["reaction_ms"]


def test_the_approach_speed_counts_near_the_retina_only():
    def tip_mm(s):
        return 0.0, -3.0 * s if s < 2 else -6.0 - 1.5 * (s - 2)

    measures = measure_trial(steps_of(5, lambda s: 1.0, tip_mm=tip_mm, near=lambda s: s > 2.6))
    assert measures["approach_speed_mm_s"] == pytest.approx(1.5, rel=0.05)
    back = measure_trial(steps_of(5, lambda s: 1.0, tip_mm=lambda s: (0.0, -9.0 + s), near=lambda s: True))
    assert back["approach_speed_mm_s"] == 0.0


def test_a_short_gap_is_bridged_by_a_straight_line():
    short = measure_trial(steps_of(8, lambda s: 1.0, detected=lambda s: not 3 < s < 3.4))
    assert short["path_mm"] == pytest.approx(8.0, rel=0.01) and "sparc" in short
    assert short["long_gaps"] == 0


@settings(max_examples=40)
@given(st.floats(0, 8), st.floats(0.51, 8), st.booleans())
def test_after_a_long_gap_anywhere_there_is_neither_path_nor_smoothness(start_s, lasts_s, hit):
    def detected(s):
        return not start_s < s < start_s + lasts_s

    times_s = np.arange(241) / RATE_HZ
    seen_s = [0.0, *(s for s in times_s if detected(s)), times_s[-1]]
    measures = measure_trial(steps_of(8, lambda s: 1.0, detected=detected, hit=hit))
    has_long_gap = np.diff(seen_s).max() > 0.5 + 1e-9
    assume(has_long_gap or np.diff(seen_s).max() < 0.5 - 1e-9)
    for name in ("path_mm", "sparc", "log_jerk"):
        assert (name in measures) != has_long_gap
    assert (measures["long_gaps"] > 0) == has_long_gap
    assert measures["longest_gap_s"] == pytest.approx(np.diff(seen_s).max(), abs=1e-6)


def wandering_mm(s):
    """A needle that pauses, turns and trembles."""
    return (
        1.5 * np.sin(0.7 * s) + 0.4 * np.sin(5 * s) + 0.02 * np.sin(2 * np.pi * 9 * s),
        -8.0 + 2.0 * np.cos(0.9 * s) + 0.3 * np.sin(7 * s + 1),
    )


def test_measures_of_a_movement_do_not_depend_on_the_rate_of_the_images():
    def at(rate_hz):
        theta_deg = lambda s: 6.0 - 4.0 * np.clip(s - 3.4, 0, 1)  # noqa: E731
        steps = steps_of(
            12, theta_deg, tip_mm=wandering_mm, near=lambda s: True, cue=lambda s: s >= 3, rate_hz=rate_hz
        )
        return measure_trial(steps)

    reference = at(120)
    for rate_hz in (60, 30, 25, 20):
        measures = at(rate_hz)
        for name in ("path_mm", "approach_speed_mm_s"):
            assert measures[name] == pytest.approx(reference[name], rel=0.002), rate_hz
        assert measures["sparc"] == pytest.approx(reference["sparc"], abs=0.01)
        assert measures["log_jerk"] == pytest.approx(reference["log_jerk"], abs=0.3)
        assert measures["reaction_ms"] == pytest.approx(reference["reaction_ms"], abs=1000 / 60)
        assert measures["images_per_s"] == pytest.approx(rate_hz)
        assert ("tremor_power_mm2" in measures) == (rate_hz >= 25)
        if rate_hz >= 25:
            assert measures["tremor_power_mm2"] == pytest.approx(0.02**2 / 2, rel=0.02)
    for rate_hz in (19, 15, 10):  # smoothness needs 20 images/s
        slow = at(rate_hz)
        for name in ("path_mm", "approach_speed_mm_s"):
            assert slow[name] == pytest.approx(reference[name], rel=0.005), rate_hz
        assert slow["reaction_ms"] == pytest.approx(reference["reaction_ms"], abs=1000 / rate_hz)
        assert not {"sparc", "log_jerk", "tremor_power_mm2"} & slow.keys()
    slower = at(9)
    assert not {"path_mm", "sparc", "reaction_ms", "approach_speed_mm_s"} & slower.keys()
    assert slower["completion_s"] == 12.0


def test_uneven_intervals_hardly_change_the_power_of_a_tremor():
    rng = np.random.default_rng(3)
    at_s = np.arange(600) / RATE_HZ + rng.uniform(-0.05, 0.05, 600) / RATE_HZ
    steps = [
        replace(step, stamp_ns=round(s * 1e9), observation=replace(step.observation, found=tip_at(s)))
        for step, s in zip(steps_of(19.95, lambda s: 1.0), at_s + 1, strict=False)
    ]
    power = measure_trial(steps)["tremor_power_mm2"]
    assert power == pytest.approx(0.02**2 / 2, rel=0.05)
    without = [step for number, step in enumerate(steps) if not 200 < number < 210]
    assert measure_trial(without)["tremor_power_mm2"] == pytest.approx(power, rel=0.02)


def tip_at(s):
    return {"needle_tip": Point(wandering_mm(s))}


def test_a_trial_without_hit_is_measured_to_its_end_and_one_without_entry_not_at_all():
    missed = measure_trial(steps_of(4, lambda s: 2.0, hit=False))
    assert "completion_s" not in missed and missed["path_mm"] == pytest.approx(4.0, rel=0.02)
    outside = [
        replace(step, graph=SceneGraph(step.stamp_ns)) for step in steps_of(4, lambda s: 2.0, hit=False)
    ]
    assert measure_trial(outside).keys() == QUALITY and measure_trial([]) == {}
    undetected = measure_trial(steps_of(2, lambda s: 2.0, detected=lambda s: False))
    assert undetected["time_unknown_s"] == pytest.approx(2.0) and "path_mm" not in undetected


@pytest.fixture(scope="module")
def recording(quick_uri, tmp_path_factory):
    path = tmp_path_factory.mktemp("trial") / "run.mcap"
    assert call("run", quick_uri, "--fast", "--record", path).exit_code == 0
    return path


def test_a_recorded_run_is_measured_as_in_the_paper_and_the_store_accepts_it(recording):
    measures = measure_recording(recording)
    run = measure_run(step for _, step in RunReader(recording).records(images=()))
    assert measures["completion_s"] == run.completion_s
    assert measures["mean_theta_deg"] == run.mean_theta_deg
    assert measures["contacts"] == run.contacts == 1
    times = {name: value for name, value in measures.items() if name.startswith("time_")}
    assert sum(times.values()) == pytest.approx(run.completion_s)
    assert len(times) == 9
    assert check_measures(measures) == measures
    assert measures["images_per_s"] == pytest.approx(15)  # too few for smoothness and tremor
    lacking = {"reaction_ms", "tremor_power_mm2", "sparc", "log_jerk"}
    assert {field.name for field in MEASURES} - measures.keys() <= lacking


def test_an_interrupted_recording_is_no_trial(recording, tmp_path):
    half = tmp_path / "half.mcap"
    half.write_bytes(recording.read_bytes()[:-2000])
    with pytest.raises(BadInput, match=r"half\.mcap: was interrupted, so it is no trial"):
        measure_recording(half)
