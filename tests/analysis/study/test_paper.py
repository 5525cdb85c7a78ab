import math
import re
import tomllib
from importlib import resources

import numpy as np
import pytest
from paths import SHARED
from scipy import stats
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.paper import beside_paper
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.tables import read_tables

PAPER = tomllib.loads((resources.files("haptigraph.analysis.study") / "paper.toml").read_text("utf-8"))


def results_of(folder, plan=None, **made):
    tables = simulated_study(
        **{"participants": 6, "trials": 1, "conditions": ("visual_only", "visual_haptic"), **made}
    )
    return analyse(read_tables(write_study(folder, tables)), plan or AnalysisPlan())


@pytest.mark.skipif(not (SHARED / "reference" / "paper.tex").is_file(), reason="needs the paper")
def test_the_published_numbers_are_those_of_the_paper():
    tex = (SHARED / "reference" / "paper.tex").read_text()
    results = tex[tex.index(r"\label{tab:results}") : tex.index(r"\subsection{Behavioral Strategy")]
    for measure in PAPER["measure"]:
        first, second = (rf"{mean} \pm {sd}" for mean, sd in zip(measure["mean"], measure["sd"], strict=True))
        assert re.search(rf"{re.escape(first)}.*\n.*{re.escape(second)}.*\n& \${measure['p']}", results)
    assert f"(N={PAPER['participants']})" in tex
    assert all(figure["title"].lower() in tex.lower() for figure in PAPER["figure"])


def test_a_study_with_the_papers_conditions_is_set_beside_the_paper(tmp_path):
    results = results_of(tmp_path)
    table = beside_paper(results, simulated=False).table
    paper, here = table.rows[:2]
    assert paper[1:] == ["paper", "16", "87.3 ± 20.4", "87.6 ± 20.6", "+0.3", "0.821"]
    values = results.values["completion_s"]
    difference = values["visual_haptic"] - values["visual_only"]
    half = stats.t.ppf(0.975, 5) * difference.std() / math.sqrt(6)
    found = [float(number) for number in re.findall(r"[-+]?\d+\.\d", here[5])]
    mean = difference.mean()
    np.testing.assert_allclose(found, [mean, mean - half, mean + half], atol=0.051)
    assert here[1:3] == ["this study", "6"] and here[3].startswith(f"{values['visual_only'].mean():.1f} ± ")
    contacts = results.runs.groupby("condition")["contacts"].sum()
    assert [f"{contacts[name]:.0f}" for name in ("visual_only", "visual_haptic")] in [
        row[3:5] for row in table.rows
    ]


def test_so_few_participants_have_no_intervals(tmp_path):
    few, enough = (
        beside_paper(results_of(tmp_path / str(count), participants=count), simulated=False).table.rows[1]
        for count in (5, 6)
    )
    assert few[5].endswith(" [-]") and "[-]" not in enough[5]
    one = beside_paper(results_of(tmp_path / "one", participants=1), simulated=False).table.rows[1]
    assert "±" not in one[3]


def test_the_columns_are_the_papers_whatever_the_reference(tmp_path):
    table = beside_paper(results_of(tmp_path / "one"), simulated=False).table
    turned = beside_paper(
        results_of(tmp_path / "two", AnalysisPlan(baseline="visual_haptic")), simulated=False
    ).table
    assert turned.head == table.head and turned.rows == table.rows


def test_another_study_is_not_set_beside_the_paper(tmp_path):
    assert beside_paper(results_of(tmp_path / "one", conditions=("visual", "sham")), simulated=False) is None
    assert beside_paper(results_of(tmp_path / "two", participants=12, within=False), simulated=False) is None


def test_measures_that_a_study_lacks_are_left_empty(tmp_path):
    tables = simulated_study(5, trials=1, conditions=("visual_only", "visual_haptic"))
    tables["trials"] = tables["trials"].drop(columns=["contacts", "time_misaligned_retinal_approach_s"])
    folder = write_study(tmp_path, {"trials": tables["trials"]})
    table = beside_paper(analyse(read_tables(folder), AnalysisPlan()), simulated=False).table
    empty = [row[2:] for row in table.rows if row[1] == "this study" and row[2] == "0"]
    assert empty == [["0", "-", "-", "-", "-"]] * 3  # SUS, contacts, misaligned retinal approach
