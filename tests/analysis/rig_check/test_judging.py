"""`rig check` finds every sabotage, each by a finding of its own, and nothing in sound set-ups."""

import numpy as np
import pytest
from helpers import mostly_slow
from paths import RENDERINGS, SHARED
from rig_setups import SABOTAGES, clip_setup, judged, simulated_setup

SEED = 9101  # neither of development nor of the figures in docs/how_to/rig_check.md
MEDIUM = 1


@pytest.fixture(scope="module")
def sound():
    return simulated_setup(0, SEED, has_mark=True, has_reference=True)


def test_a_sound_rig_passes_and_everything_is_judged(sound):
    judgement = judged(sound)
    assert judgement.findings == ()
    assert judgement.not_judged == ()
    assert {subject.outcome for subject in judgement.subjects} == {"passed"}


def test_there_are_ten_sabotages():
    assert len(SABOTAGES) == 10
    assert len({expected for _, expected in SABOTAGES.values()}) == 10


@pytest.mark.parametrize("name", mostly_slow(SABOTAGES, "target off", "moved since registration"))
def test_each_sabotage_is_found_by_its_own_finding(sound, name):
    sabotage, expected = SABOTAGES[name]
    judgement = judged(sabotage(sound, MEDIUM, np.random.default_rng(SEED)))
    sentences = {finding.name: finding.sentence for finding in judgement.findings}
    assert expected in sentences
    assert "valid" in sentences[expected] or "must" in sentences[expected] or "correct" in sentences[expected]
    failed = [subject for subject in judgement.subjects if subject.outcome == "failed"]
    assert any(expected in {finding.name for finding in subject.findings} for subject in failed)


def test_without_rig_reference_and_mark_what_cannot_be_judged_is_said(sound):
    bare = simulated_setup(1, SEED, has_mark=False, has_reference=False)
    judgement = judged(bare.without_rig())
    assert judgement.findings == ()
    assert {subject.name for subject in judgement.not_judged} >= {"mirroring", "scale", "target"}
    assert all(subject.outcome == "not judged" for subject in judgement.not_judged)


@pytest.mark.parametrize("name", mostly_slow(["dark_bowl_long", "golden_thin"], "golden_thin"))
def test_rendered_pictures_pass(name):
    assert judged(clip_setup(RENDERINGS / name)).findings == ()


@pytest.mark.parametrize("name", ["A_easy", "B_dark"])
def test_labelled_clips_pass(name):
    folder = SHARED / "clips" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    assert judged(clip_setup(folder)).findings == ()
