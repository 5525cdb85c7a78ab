"""Four participants complete a study in real browsers, which is then exported, published, and reported.

They feel the test controller from an amplitude of 0.2 on. Look at what it leaves:
`make test-slow TESTS="tests/dashboard/study/test_whole_study.py --basetemp=/tmp/whole"`.
"""

import csv
import shutil
import subprocess
import sys

import pytest
from helpers import call
from live_bench import close_page, evaluate, until
from studying import (
    Station,
    aligned_source,
    answer_all,
    begin,
    close_study,
    experimenter_at,
    kill,
    participant_at,
    push_to_the_target,
    rows_of,
    wait_for_stage,
)

from haptigraph.study.tables import CALIBRATION, EVENTS, SESSIONS, TRIALS

pytestmark = [
    pytest.mark.slow, pytest.mark.browser, pytest.mark.timeout(1800),
]  # fmt: skip
FELT_FROM = 0.2
PROTOCOL = """
[study]
name = "whole"
title = "Align with and without touch"
design = "within"
participants = 4
seed = 3
blind = "everyone"

[texts]
briefing = "Steer the needle to the target."
consent = "I take part of my own free will."

[calibration]
stimuli = 20
presentations = 1
times_threshold = 1.5

[training]
before = "study"
condition = "felt"
trials = 3
until_hits = 1
free = false

[trials]
repetitions = 2

[[condition]]
name = "felt"
title = "With touch"

[[condition]]
name = "seen"
title = "Sight alone"
touch = false

[[target]]
name = "left"
along_mm = -2

[[target]]
name = "right"
along_mm = 3

[[questionnaire]]
file = "demographics"
when = "start"

[[questionnaire]]
file = "nasa_tlx"
when = "condition"

[[questionnaire]]
file = "sharing"
when = "end"

[analysis]
primary = ["mean_theta_deg"]
equivalence = { completion_s = [-10.0, 10.0] }

[[analysis.hypothesis]]
measure = "mean_theta_deg"
first = "felt"
second = "seen"

[[analysis.hypothesis]]
measure = "completion_s"
first = "felt"
second = "seen"
expect = "equivalent"
"""


def calibrate(person):
    """Answer every stimulus of the threshold as somebody who feels from 0.2 on, and name every pattern."""
    while (stage := person.evaluate("document.body.dataset.stage")).startswith("calibration"):
        count = person.inner_text("#calibration-count")
        person.evaluate("() => { window.rumble.length = 0; }")
        person.click("#try:enabled")
        person.wait_for_selector("#choices:not([hidden]) button:enabled")
        strongest = person.evaluate(
            "() => Math.max(0, ...window.rumble.map((each) => each.strongMagnitude ?? 0))"
        )
        names = person.locator("#choices button").all_inner_texts()
        right = 0 if strongest >= FELT_FROM else 1
        person.click(f"#choices button >> nth={right if len(names) == 2 else 0}")
        until(
            person,
            f"document.body.dataset.stage !== '{stage}' || document.querySelector('#calibration-count').innerText !== '{count}'",
        )


def refuse_without_output(lab, station, open_page):
    """The trial of somebody who can feel nothing does not begin."""
    person = participant_at(station, open_page, pad=False)
    wait_for_stage(person, "training/0/0/1")
    person.wait_for_selector("text=there is no haptic output")
    assert person.is_disabled("#begin")
    lab.wait_for_selector("#problem:has-text('there is no haptic output')")
    close_page(person)


def test_four_participants_from_consent_to_report(tmp_path, open_page):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "study.toml").write_text(PROTOCOL)
    source = aligned_source(tmp_path)
    for number in range(1, 5):
        run_participant(folder, source, number, open_page)
    trials = rows_of(folder, TRIALS, "participant", "phase", "outcome", "void")
    assert [row[1:] for row in trials if row[3] is None and row[1] == "trial"] == [
        ("trial", "hit", None)
    ] * 16
    assert [row[1:] for row in trials if row[3]] == [("trial", "aborted", "interrupted")]
    assert len(rows_of(folder, SESSIONS, "participant", "session")) == 5
    stimuli = rows_of(folder, CALIBRATION, "participant", "task")
    assert sum(task == "threshold" for _, task in stimuli) == 80
    assert {text for kind, text in rows_of(folder, EVENTS, "kind", "text") if kind == "felt"} == {
        "controller: Test controller"
    }

    assert "4 of 4 participants" in call("study", "status", folder).output
    checked = call("study", "check", folder)
    assert checked.exit_code == 0 and "seen > felt" not in checked.output  # blinded
    assert call("study", "export", folder, "-o", tmp_path / "export").exit_code == 0
    report = call("study", "report", folder, "-o", tmp_path / "report")
    assert report.exit_code == 0 and "Preregistered hypotheses" in report.output
    with (tmp_path / "report" / "csv" / "thresholds.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert len(found) == 4
    for row in found:
        assert float(row["low"]) <= FELT_FROM <= float(row["high"]), row
    assert call("study", "export", folder, "--osf", "-o", tmp_path / "bundle").exit_code == 0
    shutil.copytree(tmp_path / "bundle", tmp_path / "elsewhere" / "bundle")
    done = subprocess.run(
        [sys.executable, "reproduce.py"], cwd=tmp_path / "elsewhere/bundle", capture_output=True, text=True
    )
    assert done.returncode == 0 and "identical" in done.stdout, done.stdout + done.stderr


def run_participant(folder, source, number, open_page):
    with Station(folder, source) as station:
        lab = experimenter_at(station, open_page)
        lab.click("#enrol button")
        if number == 1:
            lab.click("#unenrol")  # a slip of the mouse, and another
            lab.click("#confirm")
            lab.wait_for_selector("#participant:empty", state="attached")
            lab.click("#enrol button")
        person = participant_at(station, open_page)
        wait_for_stage(person, "briefing")
        person.click("text=Continue")
        person.click("text=I agree")
        wait_for_stage(person, "questionnaire/demographics")
        answer_all(person)
        person.click("text=Submit")
        wait_for_stage(person, "calibration/threshold")
        calibrate(person)
        wait_for_stage(person, "training/0/0/1")
        if number == 2:
            close_page(person)
            refuse_without_output(lab, station, open_page)
            person = participant_at(station, open_page)
        for position in (0, 1, 2):
            run_condition(lab, person, position)
            if position == 1 and number == 3:
                begin(person)
                until(lab, "page.header?.index > 30")
                kill(station)
                break
        else:
            finish(lab, person, station, open_page)
            return
        close_page(lab)
        close_page(person)
        open_page.close_all()
    with Station(folder, source) as station:  # after the crash
        lab, person = experimenter_at(station, open_page), participant_at(station, open_page)
        lab.click("#roster button:has-text('Resume')")
        wait_for_stage(person, "trial/2/1/1")
        assert evaluate(person, "page.status.stage.attempt") == 2
        run_condition(lab, person, 2)
        finish(lab, person, station, open_page)


def run_condition(lab, person, position):
    """Complete the training (position 0), or the trials and the questionnaire of a condition."""
    keys = [f"trial/{position}/1/{trial}" for trial in (1, 2)] if position else ["training/0/0/1"]
    for key in keys:
        wait_for_stage(person, key)
        for page in (lab, person):
            assert not {"With touch", "Sight alone"} & set(page.inner_text("body").splitlines())
        begin(person)
        push_to_the_target(person)
    if position:
        wait_for_stage(person, f"questionnaire/nasa_tlx/{position}")
        answer_all(person)
        person.click("text=Submit")


def finish(lab, person, station, open_page):
    wait_for_stage(person, "questionnaire/sharing")
    answer_all(person)
    person.click("text=Submit")
    wait_for_stage(person, "thanks")
    person.click("text=Finish")
    close_study(lab, person, station, open_page)
