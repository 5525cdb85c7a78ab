import hashlib
import json

import pandas as pd
import pytest
from study_tables import PROTOCOL, freeze, simulated_study, write_study

from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.traces import read_traces
from haptigraph.analysis.study.writing.methods import methods
from haptigraph.study.frozen.parts import sha256_of_parts


def methods_of(folder, **changes) -> str:
    """Return the methods of a study in which columns of the trials were replaced."""
    made = changes.pop("made", None) or simulated_study(4, trials=1)
    write_study(folder, {**made, "trials": made["trials"].assign(**changes)})
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    return "\n".join(methods(tables, results, read_traces(results.runs, folder), simulated=True))


def test_two_participants_in_opposite_orders_did_not_meet_the_same_order(tmp_path):
    text = methods_of(tmp_path, made=simulated_study(2, trials=1))
    assert "same order" not in text and "Completion Time: 2 participants are too few" in text
    assert "Order and learning were not modelled." in text


def test_one_participant_met_no_order_together_with_others(tmp_path):
    text = methods_of(tmp_path, made=simulated_study(1, trials=4))
    assert "same order" not in text and "Alignment Angle: only one participant has values" in text
    assert text.startswith("1 simulated participant (no people took part), within-subject design; 1 of them")


def test_constant_values_have_no_model_because_they_are_constant(tmp_path):
    text = methods_of(tmp_path, mean_theta_deg=5.0)
    assert "same order" not in text and "Alignment Angle: all values are equal" in text


def test_a_fixed_order_is_still_reported(tmp_path):
    made = simulated_study(6, trials=2)
    position = made["trials"]["condition"].map({"visual": 1, "visual_haptic": 2})
    text = methods_of(tmp_path, made=made, position=position)
    assert "Completion Time: all participants met the conditions in the same order" in text


def test_a_time_that_nobody_completed_is_not_called_unrecorded(tmp_path):
    text = methods_of(tmp_path, outcome="timeout")
    (unrecorded,) = [part for part in text.split(". ") if "Not recorded: " in part]
    assert "Completion Time" not in unrecorded
    assert "No value of Completion Time, as no run ended with a hit." in text


def test_participants_without_all_conditions_are_not_said_to_have_completed_them(tmp_path):
    made = simulated_study(4, trials=1)
    missing = (made["trials"]["participant"] == "S02") & (made["trials"]["condition"] == "visual")
    made["trials"].loc[missing, "outcome"] = "aborted"
    assert "4 simulated participants (no people took part), within-subject design; 3 of them" in methods_of(
        tmp_path, made=made
    )


PARTS = {"study.toml": PROTOCOL, "procedure p": "text"}
FROZEN = {
    "parts": PARTS,
    "frozen_utc": "2026-11-02T09:30:00+00:00",
    "protocol_sha256": sha256_of_parts(PARTS),
}
RUN = hashlib.sha256(b"text").hexdigest()


@pytest.mark.parametrize(
    ("frozen", "run", "expected"),
    [
        (None, RUN, "Whether the protocol was edited after the first participant is not known: no text"),
        (FROZEN, RUN, "froze the protocol (2026-11-02 09:30 UTC, SHA-256 "),
        (FROZEN, RUN, "Whether it was edited afterwards is not known"),
        ({**FROZEN, "edited_parts": []}, RUN, "had not been edited when the data were exported. All 8 runs"),
        ({**FROZEN, "edited_parts": ["procedure p"]}, RUN, "procedure p was changed. This report follows"),
        (FROZEN, "0" * 64, "Of 8 runs with a known procedure, 8 have another text than a frozen one"),
    ],
)
def test_the_protocol_was_frozen_or_edited_or_it_is_not_known(tmp_path, frozen, run, expected):
    if frozen:
        (tmp_path / "study.json").write_text(json.dumps(frozen))
    assert expected in methods_of(tmp_path, procedure_sha256=run)


@pytest.mark.parametrize(
    "frozen", [{**FROZEN, "parts": {**PARTS, "study.toml": PROTOCOL + "# changed"}}, FROZEN]
)
def test_procedures_are_not_compared_with_texts_that_a_bundle_changed(tmp_path, frozen):
    (tmp_path / "study.json").write_text(json.dumps(frozen))
    assert ("runs with a known procedure" in methods_of(tmp_path, procedure_sha256=RUN)) == (frozen == FROZEN)


def test_without_comparable_values_no_test_is_claimed(tmp_path):
    made = simulated_study(2, trials=1, within=False)
    made["trials"]["condition"] = ["visual", "visual", "visual_haptic", "visual_haptic"]
    columns = made["trials"].columns
    for name in columns[columns.get_loc("completion_s") :]:
        made["trials"][name] = pd.NA
    text = methods_of(tmp_path, made={**made, "answers": made["answers"].iloc[:0]})
    assert "No conditions could be compared" in text and "compared by ." not in text
    assert "corrected by Holm's" not in text


@pytest.mark.parametrize("has_protocol", [True, False])
def test_time_vibrating_is_not_tested_where_there_is_no_touch(tmp_path, has_protocol):
    folder = write_study(tmp_path, simulated_study(4, trials=1))
    trials = pd.read_csv(folder / "trials.csv").fillna({"vibrating_s": 0.0})
    trials.to_csv(folder / "trials.csv", index=False)
    if has_protocol:
        freeze(folder)
    results = analyse(read_tables(folder), AnalysisPlan())
    tested = [each.quantity.name for family in results.families for each in family.comparisons]
    assert "vibrating_s" in results.values and "vibrating_s" not in tested and "path_mm" in tested
    text = "\n".join(methods(read_tables(folder), results, read_traces(results.runs, folder), simulated=True))
    title = "Eyes" if has_protocol else "Visual"
    assert f"0 by construction without haptic output: Time Vibrating (“{title}”)." in text
    secondary = next(family for family in results.families if family.name == "secondary")
    assert secondary.explored == 3  # contacts, path, sparc


def test_two_conditions_with_touch_are_compared_even_if_one_never_vibrated(tmp_path):
    folder = write_study(tmp_path, simulated_study(4, trials=1))
    trials = pd.read_csv(folder / "trials.csv").fillna({"vibrating_s": 0.0})
    trials.to_csv(folder / "trials.csv", index=False)
    freeze(folder, '[[condition]]\nname = "visual"\n[[condition]]\nname = "visual_haptic"\n')
    results = analyse(read_tables(folder), AnalysisPlan())
    tested = [each.quantity.name for family in results.families for each in family.comparisons]
    assert "vibrating_s" in tested and not results.untested
