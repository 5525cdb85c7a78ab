"""Jobs in processes of their own: their answers, priority and end."""

import os
import sys
from contextlib import aclosing
from pathlib import Path

import pytest
from event_loop import run_in_thread
from helpers import call
from paths import ROOT

from haptigraph.config import SourceConfig
from haptigraph.dashboard.jobs.main import JOBS
from haptigraph.dashboard.jobs.process import MODULE, Jobs


async def answers(jobs, job, *arguments):
    return [content async for content, _ in jobs.run(job, *arguments)]


def jobs_of(folder):
    """The ids of the processes of this program that run a job in a folder."""
    tasks = Path("/proc/self/task").glob("*/children")
    found = [int(number) for task in tasks for number in task.read_text().split()]
    commands = {each: Path(f"/proc/{each}/cmdline").read_text().split("\0") for each in found}
    return [each for each, words in commands.items() if MODULE in words and str(folder) in words]


def test_a_job_runs_in_its_folder_and_reports_progress(recordings):
    *before, last = run_in_thread(answers(Jobs(recordings), "timeline", "quick.mcap"))
    assert {each["type"] for each in before} == {"progress", "places"}
    assert last["type"] == "timeline"
    assert last["has_truth"]


def test_a_job_imports_from_where_its_parent_does(quick_uri, tmp_path, monkeypatch):
    """As `python -m haptigraph` does from the folder where it started; but never from the job's own folder."""
    (tmp_path / "module").mkdir()
    (tmp_path / "module" / "my_lab.py").write_text((ROOT / "tests" / "support" / "own_parts.py").read_text())
    path = tmp_path / "run.mcap"
    monkeypatch.syspath_prepend(tmp_path / "module")
    call("run", quick_uri, "--fast", "--record", path, "--set", "perception.perceiver=my_lab:Perceiver")
    *_, last = run_in_thread(answers(Jobs(tmp_path), "compare", "run.mcap", "subretinal_injection"))
    assert last["type"] == "comparison", last


def test_a_refusal_is_one_sentence(recordings):
    (refused,) = run_in_thread(answers(Jobs(recordings), "timeline", "notes.mcap"))
    assert (refused["type"], refused["problem"].partition(":")[0]) == ("problem", "notes.mcap")


def test_an_unexpected_exit_is_reported(tmp_path, capfd):
    (message,) = run_in_thread(answers(Jobs(tmp_path), "nothing"))
    assert message["problem"] == "the job ended unexpectedly (exit code 1); see the terminal"
    assert "KeyError" in capfd.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("job", ["png", "register"])
def test_a_job_has_low_priority_and_ends_with_its_listener(recordings, job):
    async def run_shortly() -> tuple[int, list[int]]:
        arguments = ("quick.mcap", SourceConfig(), [], True, 24.0)[: 1 if job == "png" else 5]
        async with aclosing(Jobs(recordings).run(job, *arguments)) as messages:
            await anext(messages)
            (child,) = jobs_of(recordings)
            nice = os.getpriority(os.PRIO_PROCESS, child)
        return nice, jobs_of(recordings)

    nice, left = run_in_thread(run_shortly())
    assert nice == min(os.nice(0) + JOBS[job][1], 19)
    assert left == []
