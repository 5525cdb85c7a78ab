import pytest

from haptigraph.study.exchange.exporting import About
from haptigraph.study.protocol import load_protocol
from haptigraph.study.sharing.preregistration import preregistration
from haptigraph.study.sharing.protocol_files import publishable_parts, write_parts

ANALYSIS = """
[analysis]
primary = ["completion_s", "mean_theta_deg"]
alpha = 0.05
[analysis.equivalence]
completion_s = 10
[[analysis.hypothesis]]
measure = "mean_theta_deg"
says = "smaller with touch"
"""


def text_of(protocol, more=""):
    parts = {**protocol.parts, "study.toml": protocol.parts["study.toml"] + more}
    return preregistration(protocol, About("small", "A small study", 0, "ab12", parts, "0.1.0", "2026-11"))


def test_it_states_what_the_protocol_fixes(protocol):
    text = text_of(protocol)
    for line in (
        "# Preregistration: A small study",
        "froze in 2026-11. The SHA-256 of its texts is\n`ab12`",
        "* Within-subject: every participant completes all conditions.",
        "* Seen only (`seen`): no haptic feedback",
        "* 4 participants",
        "* Targets, along the retina from its lowest point: `left` -3 mm, `right` +3 mm.",
        "* Training once, under `felt`: 1 trial of up to 60 s.",
        "* Under each condition 1 block of 2 trials of up to 300 s",
        "* Questionnaire “System Usability Scale” (10 items), after each condition.",
        "* `completion_s` [s]: from the tip's first entry",
        "the analysis is exploratory",
    ):
        assert line in text


def test_it_states_calibration_and_criterion_of_training(folder):
    file = folder / "study.toml"
    text = file.read_text().replace("[training]\n", "[training]\nuntil_hits = 1\nfree = false\n")
    file.write_text(text + "\n[calibration]\nstimuli = 20\npresentations = 1\ntimes_threshold = 3\n")
    stated = text_of(load_protocol(folder))
    assert "threshold of vibration from 20 stimuli; the naming of every pattern, 1 times each." in stated
    assert "The weakest pattern has 3 times the threshold." in stated and "until 1 hit in a row." in stated


def test_it_states_the_table_of_the_analysis_whatever_its_keys(protocol):
    text = text_of(protocol, ANALYSIS)
    for line in (
        "* primary: completion_s, mean_theta_deg\n",
        "* alpha: 0.05\n",
        "* equivalence: completion s: 10\n",
        "* hypothesis 1: says: smaller with touch\n",
    ):
        assert line in text
    assert "exploratory" not in text


@pytest.mark.parametrize("name", ["own.toml", "more/own.toml", "../own.toml", "/etc/own.toml"])
def test_a_published_protocol_stays_in_its_folder(tmp_path, protocol, name):
    out = tmp_path / "out"
    out.mkdir()
    write_parts(out, {**protocol.parts, f"questionnaire {name}": "text"})
    inside = name if name == "more/own.toml" else "own.toml"
    assert (out / inside).read_text() == "text"
    assert {path.name for path in tmp_path.iterdir()} == {"out", "study.toml"}
    assert load_protocol(out).parts == protocol.parts


def test_contacts_leave_the_texts_and_the_protocol_still_loads(tmp_path, protocol):
    text = protocol.parts["study.toml"].replace("Hit the target.", "Ask meier@uni.example.")
    parts, count = publishable_parts({**protocol.parts, "study.toml": text})
    out = tmp_path / "out"
    out.mkdir()
    write_parts(out, parts)
    assert count == 1 and load_protocol(out).texts.briefing == "Ask (contact left out)."
