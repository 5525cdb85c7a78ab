import builtins
import re
import runpy

from helpers import call
from paths import ROOT

from haptigraph.study.roster import Study
from haptigraph.study.status import participant_statuses

PAGE = ROOT / "docs" / "study.md"


def test_the_documented_program_takes_a_participant_through_the_papers_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("study", "new", "my-study").exit_code == 0
    prompts = []

    def answer(prompt: str) -> str:
        prompts.append(prompt)
        choice = re.search(r"one of ([^,)]+)", prompt)
        return choice[1] if choice else "3" if "scale" in prompt or "whole number" in prompt else "20"

    monkeypatch.setattr(builtins, "input", answer)
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(program, names)
    study = names["study"]
    assert isinstance(study, Study)
    (status,) = participant_statuses(study)
    study.store.close()
    assert status.next.ended == "all is done"
    assert len(prompts) == 8 + 3 + 20  # demographics, trials, SUS twice


def test_the_tables_of_a_rehearsal_leave_out_what_was_not_tested(tmp_path):
    columns = "measure,first,second,mean_first,sd_first,mean_second,sd_second,p,p_holm,r,r_low,r_high\n"
    (tmp_path / "comparisons.csv").write_text(
        columns + "mean_theta_deg,seen,felt,8.1,4.6,4.8,2.9,0.058,0.0001,-0.54,,\n"
        "path_mm,seen,felt,21,0,21,0,,,,,\n"
    )
    comparisons = runpy.run_path(str(ROOT / "docs" / "study_pictures.py"))["comparisons"]
    assert comparisons(tmp_path / "comparisons.csv").splitlines()[2:] == [
        "| mean theta (deg) | seen → felt | 8.1 ± 4.6 | 4.8 ± 2.9 | 0.058 | < 0.001 | -0.54 |",
        "| path (mm) | seen → felt | 21.0 ± 0.0 | 21.0 ± 0.0 |  |  |  |",
    ]
