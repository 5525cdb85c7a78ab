"""A safety case: what holds, what fails or is missing, and that every file shows exactly that."""

import csv
import io
import re
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from evidence_files import SCORES, record, write_faults, write_scores
from helpers import mostly_slow
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from haptigraph.analysis.evaluation.origin import new_origin
from haptigraph.analysis.evidence.argument import argument_svg
from haptigraph.analysis.evidence.gathering import Results, safety_case
from haptigraph.analysis.evidence.hazards import FAULTS, HAZARDS
from haptigraph.analysis.evidence.page import page
from haptigraph.analysis.evidence.tables import csv_table, markdown
from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.errors import BadInput
from haptigraph.proof.prove import prove

SVG = "{http://www.w3.org/2000/svg}"


def problems(case) -> dict[str, str]:
    """Return the status of every claim that does not hold, by its statement."""
    return {claim.statement: each.status for *_, claim, _, each in case.rows() if claim.lacks(each)}


def statuses(case, source: str) -> set[str]:
    return {each.status for *_, each in case.rows() if each.source == source}


def test_complete_results_support_the_default_procedure(results):
    case = safety_case("subretinal_injection", results)
    assert problems(case) == {}
    assert case.holds
    assert "MISSING" not in page(case) and "FAILS" not in markdown(case)


@pytest.mark.parametrize("name", procedure_names())
def test_every_claim_of_check_is_there_with_its_hazard(name):
    procedure = load_procedure(name)
    case = safety_case(name, Results())
    proved = [claim.statement for *_, claim, _, each in case.rows() if each.source == "proof"]
    assert {claim.statement for claim in prove(procedure).claims} <= set(proved)
    monitored = [claim.statement for *_, claim, _, each in case.rows() if each.source == "runs"]
    assert {claim.name for claim in procedure.temporal} <= set(monitored)
    assert all(hazard.claims for hazard in case.hazards)


def test_every_kind_of_faults_belongs_to_a_hazard():
    import campaign

    assert set(FAULTS) == set(campaign.TRIALS)
    assert {hazard for hazard, _ in FAULTS.values()} <= {hazard.key for hazard in HAZARDS}


def test_one_sabotaged_proof_one_missing_campaign_and_one_failed_claim_are_shown_exactly(
    tmp_path, quick_uri, in_real_time
):
    text = load_procedure("subretinal_injection").text
    rule = 'name = "retinal_contact"\nkind = "alarm"\nwhen = [["needle_tip", "touching", "retina_surface"]'
    assert text.count(rule) == 1
    broken = tmp_path / "broken.toml"
    broken.write_text(text.replace(rule, f'{rule}, ["needle_line", "misaligned", "retina_target"]'))
    procedure = load_procedure(str(broken))
    violated = {claim.statement for claim in prove(procedure).claims if not claim.holds}
    assert "touching the retina away from the target always feels the alarm" in violated
    scores = write_scores(tmp_path / "accuracy.json", new_origin(procedure), tip_far_rate=0.03)
    run = record(quick_uri, tmp_path / "run.mcap", str(broken))
    case = safety_case(str(broken), Results(None, [scores], [run]))
    far = {"Few reported tips are more than 0.3 mm from the true one": "fails"}
    missing = {statement: "missing" for _, statement in FAULTS.values()}
    expected = dict.fromkeys(violated, "fails") | far | missing
    assert problems(case) == expected
    rows = list(csv.DictReader(io.StringIO(csv_table(case))))
    assert {row["claim"]: row["status"] for row in rows if row["status"] != "holds"} == expected
    html, md = page(case), markdown(case)
    assert html.count("<tr") - len(HAZARDS) == len(rows)
    assert html.count("class=bad>") == len(expected)
    assert len(re.findall(r"\*\*(FAILS|MISSING)\*\*", md)) == len(expected)
    svg = ElementTree.fromstring(argument_svg(case))
    words = [element.text for element in svg.iter(f"{SVG}text")]
    assert words.count("MISSING") == len(missing)
    assert words.count("FAILS") == len(expected) - len(missing)
    diamonds = [path for path in svg.iter(f"{SVG}path") if path.find(f"{SVG}title") is not None]
    assert len(diamonds) == len(missing)


def test_results_of_another_procedure_or_other_software_are_no_evidence(tmp_path, origin, recording):
    other = msgspec.structs.replace(origin, software_sha256="0" * 64)
    faults = write_faults(tmp_path / "faults.jsonl", other)
    scores = write_scores(tmp_path / "accuracy.json", other)
    stale = safety_case("subretinal_injection", Results(faults, [scores]))
    assert statuses(stale, "faults") == statuses(stale, "accuracy") == {"stale"}
    scores = write_scores(tmp_path / "accuracy.json", origin)
    case = safety_case("subretinal_injection_cautious", Results(None, [scores], [recording]))
    assert statuses(case, "accuracy") == statuses(case, "runs") == {"other procedure"}


def test_files_that_do_not_state_their_origin_are_no_evidence(tmp_path):
    faults = write_faults(tmp_path / "faults.jsonl", None)
    scores = write_scores(tmp_path / "accuracy.json", None)
    case = safety_case("subretinal_injection", Results(faults, [scores]))
    assert statuses(case, "faults") == statuses(case, "accuracy") == {"origin not stated"}


def test_a_broken_promise_and_too_few_trials_are_shown(tmp_path, origin):
    faults = write_faults(tmp_path / "faults.jsonl", origin, failing="recover", left_out="full disk")
    with faults.open("ab") as file:
        file.write(msgspec.json.encode({"kind": "full disk", "number": 0}) + b"\n")
    shown = problems(safety_case("subretinal_injection", Results(faults)))
    assert shown[FAULTS["recover"][1]] == "fails"
    assert shown[FAULTS["full disk"][1]] == "incomplete"
    assert FAULTS["hung process"][1] not in shown


def test_delays_of_a_run_that_was_not_in_real_time_count_as_not_exercised(recording):
    shown = problems(safety_case("subretinal_injection", Results(runs=[recording])))
    assert shown["the alarm is felt within 50 ms of contact"] == "not exercised"
    assert "what is felt changes no more than 6 times in a second" not in shown


def test_results_that_do_not_count_take_nothing_from_those_that_do(tmp_path, origin):
    good = write_scores(tmp_path / "good.json", origin)
    none = write_scores(tmp_path / "none.json", origin, contact_images=0)
    bad = write_scores(tmp_path / "bad.json", origin, missed_contact_images=2)
    claim = "No contact passes as something else"
    assert claim not in problems(safety_case("subretinal_injection", Results(evaluations=[good, none])))
    assert problems(safety_case("subretinal_injection", Results(evaluations=[good, bad])))[claim] == "fails"


def test_contacts_of_all_evaluations_count_together(tmp_path, origin):
    files = [write_scores(tmp_path / f"{count}.json", origin, contact_images=count) for count in (25, 35)]
    claim = "No contact passes as something else"
    assert (
        problems(safety_case("subretinal_injection", Results(evaluations=files[:1])))[claim] == "incomplete"
    )
    assert claim not in problems(safety_case("subretinal_injection", Results(evaluations=files)))


@pytest.mark.parametrize(
    ("scores", "status"),
    [
        ({"contact_images": 0}, "not exercised"),
        ({"contact_images": 59}, "incomplete"),
        ({"missed_contact_images": 1}, "fails"),
        ({"missed_contact_images": None}, "missing"),
    ],
)
def test_contacts_are_missed_only_where_there_are_some(tmp_path, origin, scores, status):
    file = write_scores(tmp_path / "accuracy.json", origin, **scores)
    shown = problems(safety_case("subretinal_injection", Results(evaluations=[file])))
    assert shown["No contact passes as something else"] == status


def test_of_several_perceivers_that_of_the_procedure_counts(tmp_path, origin):
    bad = {**SCORES, "tip_far_rate": 0.5}
    by_name = {"threshold": {"all": bad}, "tracker": {"all": SCORES}}
    file = tmp_path / "accuracy.json"
    file.write_bytes(msgspec.json.encode({"perceivers": by_name, "origin": origin}))
    shown = problems(safety_case("subretinal_injection", Results(evaluations=[file])))
    assert "fails" not in shown.values()
    file.write_bytes(msgspec.json.encode({"perceivers": {"threshold": {"all": bad}}, "origin": origin}))
    shown = problems(safety_case("subretinal_injection", Results(evaluations=[file])))
    assert shown["Few reported tips are more than 0.3 mm from the true one"] == "fails"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "not a result of `make faults`"),
        ('{"format": "other"}', "Invalid enum value 'other'"),
        ('{"kind": "flood", "number": 1}', "'flood' are unknown; valid: damaged file"),
    ],
)
def test_other_files_than_those_of_a_campaign_are_refused(tmp_path, text, problem):
    file = tmp_path / "faults.jsonl"
    file.write_text(text)
    with pytest.raises(BadInput, match=problem) as error:
        safety_case("subretinal_injection", Results(faults=file))
    assert "line 1" in str(error.value)


@pytest.mark.parametrize("text", ["[]", "{}", '{"perceivers": {"a": {}, "b": {}}}'])
def test_other_files_than_those_of_an_evaluation_are_refused(tmp_path, text):
    file = tmp_path / "accuracy.json"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"no scores|not a result of"):
        safety_case("subretinal_injection", Results(evaluations=[file]))


@pytest.mark.parametrize("name", mostly_slow(procedure_names(), "subretinal_injection"))
def test_every_text_of_the_diagram_fits_its_shape(name, recording):
    svg = ElementTree.fromstring(argument_svg(safety_case(name, Results(runs=[recording]))))
    width = float(svg.get("width"))
    boxes = [
        [float(rect.get(key)) for key in ("x", "y", "width", "height")]
        for rect in svg.iter(f"{SVG}rect")
        if rect.get("x")
    ]
    for element in svg.iter(f"{SVG}text"):
        x, y, size = (float(element.get(key)) for key in ("x", "y", "font-size"))
        font = FontProperties(family="DejaVu Sans", weight=element.get("font-weight"))
        path = TextPath((0, 0), element.text, size=size, prop=font)
        length = np.ptp(path.vertices[:, 0])  # at least that of its curves, whose extents take long
        room = next(
            (
                left + wide - x
                for left, top, wide, high in boxes
                if left < x < left + wide and top < y < top + high
            ),
            56 if element.get("text-anchor") == "middle" else width - x,
        )
        assert length <= room, element.text
