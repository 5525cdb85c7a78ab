"""The calibration in the report: thresholds with their interval, shares with exact ones, the confusion matrix."""

import pandas as pd
import pytest
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.calibration import calibration_paragraph, calibration_tables
from haptigraph.analysis.study.report import write_report
from haptigraph.analysis.study.tables import read_tables
from haptigraph.haptics.profiles.threshold import Answered, is_catch, next_amplitude


def threshold_rows(participant, threshold):
    answers, rows = [], []
    for number in range(1, 41):
        amplitude = 0.0 if is_catch(number, 1) else next_amplitude(answers)
        answers.append(Answered(amplitude, 0 < threshold <= amplitude))
        response = "felt" if answers[-1].is_felt else "not felt"
        rows.append(dict(task="threshold", number=number, round=1, amplitude=amplitude, response=response))
    return [{"participant": participant, "device": "gamepad:0", "correct": 1, **row} for row in rows]


def pattern_rows(participant, pairs):
    return [
        dict(participant=participant, device="gamepad:0", task="patterns", number=number, round=1 + (number > 4),
             pattern=played, amplitude=0.5, response=named, correct=int(played == named))
        for number, (played, named) in enumerate(pairs, 1)
    ]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    tables = simulated_study(participants=6, trials=1)
    first = [("low", "low"), ("low", "pulse"), ("pulse", "pulse"), ("pulse", "pulse")]
    rows = [*threshold_rows("S01", 0.1), *threshold_rows("S02", -1), *threshold_rows("S03", 0.1)]
    rows += pattern_rows("S01", [*first, ("low", "low"), ("pulse", "pulse")])
    tables["calibration"] = pd.DataFrame(rows).assign(study="simulated study")
    people = tables["participants"].assign(withdrawn_utc="", enrolled_utc="2026-01-01")
    people.loc[people["participant"] == "S03", "withdrawn_utc"] = "2026-01-02"
    tables["participants"] = people
    return write_study(tmp_path / "study", tables)


def test_thresholds_and_names_of_patterns_have_their_intervals(folder):
    found = calibration_tables(read_tables(folder))
    one, two = found["thresholds"].to_dict("records")  # S03 has withdrawn
    assert (one["participant"], one["known"], one["catch_trials"], one["false_alarms"]) == (
        "S01",
        "yes",
        8,
        0,
    )
    assert one["low"] <= 0.1 <= one["high"] and one["sd_db"] < 2
    assert two["known"] == "no" and pd.isna(two["amplitude"]) and pd.isna(two["high"])
    (named,) = found["patterns_named"].to_dict("records")
    assert (named["presented"], named["correct"], named["share"]) == (4, 3, 0.75)  # the first round
    assert (named["low"], named["high"]) == pytest.approx((0.1941, 0.9937), abs=1e-4)  # R: binom.test(3, 4)
    low, pulse = found["confusion"].to_dict("records")
    assert low == {"played": "low", "low": 1, "pulse": 1, "presented": 2, "share_correct": 0.5}
    assert pulse == {"played": "pulse", "low": 0, "pulse": 2, "presented": 2, "share_correct": 1.0}
    text = calibration_paragraph(found)
    assert "known for 1 of 2 participants and devices; 0 of 16 silent" in text and "3 of 4 patterns" in text


def test_the_report_has_the_calibration_only_if_there_was_one(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])  # which take seconds
    written = write_report(folder, tmp_path / "report")
    html = written.page.read_text()
    assert "Detection thresholds of vibration amplitude" in html and "ZEST placement" in html
    assert (tmp_path / "report" / "csv" / "confusion.csv").exists()
    (folder / "calibration.csv").unlink()
    assert calibration_tables(read_tables(folder)) == {} and calibration_paragraph({}) == ""
