"""Work in processes of its own: what it answers, how it gives way, and how it ends."""

import os
import sys
from contextlib import aclosing
from pathlib import Path

import pytest
from event_loop import run_apart

from haptigraph.config import SourceConfig
from haptigraph.dashboard.jobs.main import JOBS
from haptigraph.dashboard.jobs.process import Jobs


async def answers(jobs, job, *given):
    return [content async for content, _ in jobs.frames(job, *given)]


def children():
    tasks = Path("/proc/self/task").glob("*/children")
    return [int(number) for task in tasks for number in task.read_text().split()]


def test_a_job_works_in_its_folder_and_tells_how_far_it_is(recordings):
    *before, last = run_apart(answers(Jobs(recordings), "timeline", "quick.mcap"))
    assert {each["type"] for each in before} == {"progress", "places"}
    assert last["type"] == "timeline"


def test_what_it_refuses_is_one_sentence(recordings):
    (refused,) = run_apart(answers(Jobs(recordings), "timeline", "notes.mcap"))
    assert (refused["type"], refused["problem"].partition(":")[0]) == ("problem", "notes.mcap")


def test_a_death_is_told(tmp_path, capfd):
    (told,) = run_apart(answers(Jobs(tmp_path), "nothing"))
    assert told["problem"] == "the work ended by itself (exit code 1); the terminal may say why"
    assert "KeyError" in capfd.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("job", ["png", "register"])
def test_it_gives_way_and_ends_with_who_listens(recordings, job):
    async def stopped() -> tuple[int, list[int]]:
        before = set(children())
        given = ("quick.mcap", SourceConfig(), [], True, 24.0)[: 1 if job == "png" else 5]
        async with aclosing(Jobs(recordings).frames(job, *given)) as frames:
            await anext(frames)
            (child,) = set(children()) - before
            nice = os.getpriority(os.PRIO_PROCESS, child)
        return nice, [each for each in children() if each == child]

    nice, left = run_apart(stopped())
    assert nice == min(os.nice(0) + JOBS[job][1], 19)
    assert left == []
