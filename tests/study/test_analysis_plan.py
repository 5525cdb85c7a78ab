import pytest
from helpers import call

from haptigraph.errors import BadInput
from haptigraph.study.protocol import load_protocol

ANALYSIS = """
[analysis]
primary = ["mean_theta_deg"]
min_trials = 2
equivalence = { completion_s = [-10, 10] }

[[analysis.hypothesis]]
measure = "mean_theta_deg"
first = "seen"
second = "felt"
expect = "smaller"

[[analysis.hypothesis]]
measure = "completion_s"
first = "seen"
second = "felt"
expect = "equivalent"
"""
INVALID = [
    ('primary = ["mean_theta_deg"]', 'primary = ["theta"]', r"line 45: unknown measure 'theta'; .*completion_s"),
    ('primary = ["mean_theta_deg"]', "primary = []", "line 45: primary is empty"),
    ('primary = ["mean_theta_deg"]', 'primary = ["sus"]', r"line 45: no \[\[analysis.hypothesis\]\] is about 'sus'"),
    ('primary = ["mean_theta_deg"]', 'primary = ["mean_theta_deg"]\nalpha = 5', r"line 46: .*alpha: expected .* <= 0.5"),
    ("min_trials = 2", "min_trials = 3", "line 46: min_trials = 3 excludes everyone; expected at most 2"),
    ("completion_s = [-10, 10]", "completion_s = [10, 20]", "line 47: completion_s: expected a bound below 0 and one above"),
    ("completion_s = [-10, 10]", "time = [-1, 1]", "line 47: unknown measure 'time'"),
    ("completion_s = [-10, 10]", "sus = [-1, 1]", r"line 59: completion_s has no equivalence bounds; add equivalence"),
    ('measure = "completion_s"', 'measure = "completion"', "line 56: unknown measure 'completion'; did you mean"),
    ('first = "seen"', 'first = "saw"', r"line 51: unknown condition 'saw'; .*felt, seen"),
    ('second = "felt"', 'second = "seen"', r"line 52: 'seen' is compared with itself"),
    ('expect = "smaller"', 'expect = "less"', r"line 53: unknown expect 'less'; valid: different"),
    ('measure = "completion_s"\nfirst = "seen"\nsecond = "felt"\nexpect = "equivalent"',
     'measure = "mean_theta_deg"\nfirst = "seen"\nsecond = "felt"\nexpect = "smaller"', "line 55: the same hypothesis twice"),
    ('first = "seen"\nsecond = "felt"\nexpect = "equivalent"', 'first = "felt"\nsecond = "seen"\nexpect = "equivalent"',
     "line 57: name the conditions of an equivalence in the order of the protocol"),
    ('measure = "mean_theta_deg"', 'measure = "mean_theta_dg"', "line 50: unknown measure 'mean_theta_dg'; did you mean"),
    ('primary = ["mean_theta_deg"]', 'primary = [\n  "mean_theta_deg",\n  "completion",\n]', "line 47: unknown measure 'completion'"),
    ("equivalence = { completion_s = [-10, 10] }", "[analysis.equivalence]\ncompletion_s = [-10, 10]\npath = [-1, 1]",
     "line 49: unknown measure 'path'"),
    ("min_trials = 2", "exclude_poor_trials = true", r"line 46: \[quality\] sets no threshold; set one, or remove"),
    ('expect = "smaller"', 'sides = 1', r"line 53: unknown key 'sides'"),
]  # fmt: skip


def write(folder, text: str) -> None:
    file = folder / "study.toml"
    file.write_text(file.read_text() + text)


def test_an_analysis_is_part_of_the_frozen_protocol(folder, protocol):
    assert protocol.analysis is None
    write(folder, ANALYSIS)
    found = load_protocol(folder)
    assert found.analysis.alpha == 0.05 and found.analysis.equivalence == {"completion_s": (-10, 10)}
    assert [each.expect for each in found.analysis.hypotheses] == ["smaller", "equivalent"]
    edited = found.parts | {"study.toml": found.parts["study.toml"].replace("[-10, 10]", "[-20, 20]")}
    assert found.changed_parts(edited) == ["study.toml"] and found.sha256 != protocol.sha256


@pytest.mark.parametrize(("valid", "invalid", "message"), INVALID, ids=[case[1] for case in INVALID])
def test_an_invalid_analysis_is_refused_with_its_line(folder, valid, invalid, message):
    assert valid in ANALYSIS
    write(folder, ANALYSIS.replace(valid, invalid, 1))
    with pytest.raises(BadInput, match=rf"study\.toml, {message}"):
        load_protocol(folder)


@pytest.mark.parametrize("measure", ["sus", "time_retinal_contact_s", "path_mm"])
def test_scores_and_times_in_states_are_measures(folder, measure):
    write(folder, ANALYSIS.replace("mean_theta_deg", measure))
    assert load_protocol(folder).analysis.primary == (measure,)


def test_a_score_that_is_not_about_a_condition_is_no_measure(folder):
    write(folder, ANALYSIS.replace("mean_theta_deg", "sus"))
    file = folder / "study.toml"
    file.write_text(file.read_text().replace('when = "condition"', 'when = "end"'))
    with pytest.raises(BadInput, match="unknown measure 'sus'"):
        load_protocol(folder)


def test_poor_trials_may_be_excluded_where_there_is_a_threshold(folder):
    write(folder, ANALYSIS.replace("min_trials = 2", "exclude_poor_trials = true"))
    write(folder, "\n[quality]\nmin_images_per_s = 20\n")
    assert load_protocol(folder).analysis.exclude_poor_trials
    assert "without trials beyond a threshold" in call("study", "check", folder).output


def test_the_check_prints_the_analysis_or_that_there_is_none(folder):
    assert "no [analysis] table: the report will be exploratory" in call("study", "check", folder).output
    write(folder, ANALYSIS)
    output = call("study", "check", folder).output
    assert "Preregistered analysis (alpha 0.05, at least 2 valid trials under each condition)" in output
    assert "felt: smaller" in output and "-10 to 10" in output and "exploratory" not in output


def test_the_papers_protocol_preregisters_its_analysis(tmp_path):
    call("study", "new", tmp_path)
    analysis = load_protocol(tmp_path).analysis
    assert {each.measure: each.expect for each in analysis.hypotheses} == {
        "mean_theta_deg": "smaller",
        "completion_s": "equivalent",
        "sus": "greater",
    }
