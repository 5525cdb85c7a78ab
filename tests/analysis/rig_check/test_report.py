"""The report: what decides whether a check passed, as text and as JSON."""

import msgspec
import pytest

from haptigraph.analysis.rig_check.judging import Judgement
from haptigraph.analysis.rig_check.report import lines, report_of
from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.findings import Finding

PASSED = Subject("focus", {"rim_blur_mm": 0.05})
FAILED = Subject("light", {"brightest_grey": 40.0}, (Finding("dim", "40 grey levels; 100 are valid"),))
UNJUDGED = Subject("scale", not_judged="there is no rig")


def report(*subjects, accepts_unjudged=False):
    return report_of(Judgement(subjects), "camera:0", "abc", "", accepts_unjudged=accepts_unjudged)


@pytest.mark.parametrize(
    ("subjects", "accepts_unjudged", "passes"),
    [
        ((PASSED,), False, True),
        ((PASSED, UNJUDGED), False, False),
        ((PASSED, UNJUDGED), True, True),
        ((PASSED, FAILED), True, False),
    ],
)
def test_only_what_was_judged_or_accepted_passes(subjects, accepts_unjudged, passes):
    assert report(*subjects, accepts_unjudged=accepts_unjudged).passed is passes


def test_the_text_says_what_is_wrong_and_what_is_not_known():
    text = "\n".join(lines(report(PASSED, FAILED, UNJUDGED)))
    assert "FAILED dim: 40 grey levels; 100 are valid" in text
    assert "not judged, scale: there is no rig" in text
    assert text.endswith("camera:0 did not pass: 1 finding, 1 of 3 not judged")


def test_the_json_has_the_outcome_of_every_subject():
    content = msgspec.json.decode(msgspec.json.encode(report(PASSED, FAILED, UNJUDGED)))
    assert [subject["judged"] for subject in content["subjects"]] == ["passed", "failed", "not judged"]
    assert content["passed"] is False
