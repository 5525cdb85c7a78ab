"""`robot check` finds every sabotage, each by a finding of its own, and nothing on sound interfaces."""

import pytest

pytest.importorskip("cyclonedds")

from crtk_messages import SABOTAGES, sabotaged, sound
from crtk_recording import SETUP, recorded
from msgspec.structs import replace

from haptigraph.findings import Finding
from haptigraph.robot.checking.judging import judge
from haptigraph.robot.checking.states import Enabling

SEEDS = (1001, 1002, 1003)


@pytest.fixture(scope="module")
def recordings():
    return {seed: recorded(sound(seed)) for seed in SEEDS}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sound_interface_passes(recordings, seed):
    judgement = judge(recordings[seed], SETUP)
    assert judgement.findings == ()
    assert judgement.passed
    assert judgement.measurements["pose_age_median_ms"] == pytest.approx(20, abs=2)
    assert judgement.measurements["pose_rate_hz"] == pytest.approx(100, abs=1)


def test_there_are_at_least_20_sabotages():
    assert len(SABOTAGES) >= 20


@pytest.mark.parametrize("name", SABOTAGES)
def test_each_sabotage_is_found_by_its_own_finding(name):
    expected, _ = SABOTAGES[name]
    judgement = judge(recorded(sabotaged(name, SEEDS[0])), SETUP)
    assert judgement.findings[0].name == expected
    assert not judgement.passed
    assert all("valid" in found.sentence or "must" in found.sentence for found in judgement.findings[:1])


def test_what_was_not_exercised_is_said(recordings):
    skipped = " ".join(judge(recordings[SEEDS[0]]).not_exercised)
    assert "--setup" in skipped
    assert "--enable" in skipped


def test_without_velocities_axes_need_a_calibration():
    messages = [one for one in sound(SEEDS[0]) if one.topic != "measured_cv"]
    assert [found.name for found in judge(recorded(messages), SETUP).findings] == ["axes_unverified"]
    eye = replace(SETUP.eye, residual_rms_mm=0.1)
    judgement = judge(recorded(messages), replace(SETUP, eye=eye))
    assert judgement.passed
    assert any("measured_cv is absent" in sentence for sentence in judgement.not_exercised)


def test_a_force_limit_needs_a_measured_force(recordings):
    limits = replace(SETUP.limits, force_n=0.5)
    judgement = judge(recordings[SEEDS[0]], replace(SETUP, limits=limits))
    assert [found.name for found in judgement.findings] == ["force_missing"]


def test_a_robot_that_is_silent_is_a_finding():
    assert {"state_missing", "pose_missing"} == {found.name for found in judge(recorded([])).findings}


def test_a_robot_that_was_never_enabled_fails(recordings):
    sound_one = judge(recordings[SEEDS[0]], SETUP)
    failed = sound_one.with_enabling(Enabling(None, None))
    assert [found.name for found in failed.findings] == ["never_enabled"]
    answered = sound_one.with_enabling(Enabling(12.0, 31.0))
    assert answered.passed
    assert (answered.measurements["enabled_ms"], answered.measurements["command_echo_ms"]) == (12.0, 31.0)
    assert not any("--enable" in sentence for sentence in answered.not_exercised)


def test_findings_about_topics_come_first(recordings):
    about = (Finding("topic_type", "..."),)
    assert judge(recordings[SEEDS[0]], SETUP, about).findings == about
