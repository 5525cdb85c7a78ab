import builtins
import re

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
