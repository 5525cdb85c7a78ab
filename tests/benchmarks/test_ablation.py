import subprocess
import sys

import ablation
import msgspec
import pytest
from paths import ROOT

SOURCE = """A = 3
B, C = 0.5, -1e3
PART = slice(-9, 2)
NAME, NONE = "x", 0
NESTED: int = 4


def double(number):
    TWICE = 2
    return TWICE * number
"""


def test_every_number_of_a_modules_constants_is_found_once():
    found = ablation.in_python(SOURCE, "a.py")
    assert [(number.name, number.text) for number in found] == [
        ("A", "3"),
        ("B", "0.5"),
        ("C", "1e3"),
        ("PART[0]", "9"),
        ("PART[1]", "2"),
    ]
    assert all(SOURCE[number.start :].startswith(number.text) for number in found)


def test_numbers_of_the_package_are_where_they_are_said_to_be_and_differ_in_key():
    numbers = ablation.numbers(ROOT)
    assert len(numbers) > 100
    assert {number.file.rsplit(".")[-1] for number in numbers} == {"c", "py"}
    for number in numbers:
        assert (ROOT / number.file).read_text("utf-8")[number.start :].startswith(number.text)
    assert len({ablation.key(number, "doubled") for number in numbers}) == len(numbers)


@pytest.mark.parametrize(("text", "doubled"), [("3", "6"), ("0.25", "0.5")])
def test_a_number_keeps_its_type(text, doubled):
    number = ablation.Number("a.py", "A", 0, text)
    assert number.times(2) == doubled
    assert type(msgspec.json.decode(number.times(0))) is type(msgspec.json.decode(text))


def trial(change="doubled", known=0.9, number=None):
    row = {"tip_known_rate": known, "tip_far_rate": 0.1, "state_agreement": 0.9, "missed_contact_images": 0}
    row |= {"tip_error_px": {"p95": 2.0}, "tip_z": {"p95": 2.5}}
    return ablation.Trial(number, change, [row])


def test_the_table_begins_with_what_has_the_least_effect():
    one, two = (ablation.Number("needle/a.py", name, 0, "3") for name in "AB")
    trials = [trial("unchanged"), trial(known=0.5, number=one), trial(number=two), trial("zero", 0.9, one)]
    trials.append(ablation.Trial(two, "zero", []))
    lines = ablation.table(trials).splitlines()
    assert [line.split()[:4] for line in lines[1:4]] == [
        ["a.py:A", "=", "3", "zero"],
        ["a.py:B", "=", "3", "doubled"],
        ["a.py:A", "=", "3", "doubled"],
    ]
    assert "-40.00" in lines[3]
    assert lines[4].endswith("perception fails")
    assert lines[5] == "2 of 4 changes have next to no effect"


def test_without_the_unchanged_trial_there_is_nothing_to_compare_with():
    assert "missing" in ablation.table([trial(number=ablation.Number("a.py", "A", 0, "3"))])


@pytest.mark.slow
def test_a_change_of_a_number_changes_the_scores_and_not_the_package(tmp_path, monkeypatch):
    monkeypatch.setattr(ablation, "CACHE", tmp_path)
    clip = ROOT / "tests" / "data" / "renderings" / "golden_thin"
    number = next(each for each in ablation.numbers(ROOT) if each.name == "MAX_FAR")
    before = (ROOT / number.file).read_bytes()
    plain, changed = (ablation.run(each, "zero", [clip]) for each in (None, number))
    assert (ROOT / number.file).read_bytes() == before
    assert len(plain.rows) == len(changed.rows) == 5
    assert plain.rows[0]["tip_known_rate"] > 0.9
    assert changed.rows[0]["tip_known_rate"] == 0


def test_a_folder_that_does_not_exist_is_refused_in_a_sentence():
    command = [sys.executable, ROOT / "benchmarks" / "ablation.py", "missing"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 2
    assert run.stderr.endswith("missing is no folder; give labelled clips\n")
