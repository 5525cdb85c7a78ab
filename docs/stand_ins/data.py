"""Recordings, studies and files of a clone."""

import builtins
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import haptigraph
from stand_ins.stand_in import ENVIRONMENT, ROOT, StandIn

GOLDEN = ROOT / "tests" / "replay" / "golden"


@cache
def recorded() -> tempfile.TemporaryDirectory[str]:
    """Record a run of the phantom, once for all pages."""
    folder = tempfile.TemporaryDirectory(prefix="haptigraph-recording-")
    settings = [
        "source.uri=phantom:wrong_place_then_hit",
        "run.realtime=false",
        f"recording.path={Path(folder.name) / 'run.mcap'}",
    ]
    haptigraph.build(haptigraph.load_config(settings=settings)).run()
    return folder


def recording(folder: Path) -> StandIn:
    """A recorded run of the phantom, run.mcap."""
    shutil.copyfile(Path(recorded().name) / "run.mcap", folder / "run.mcap")
    return StandIn()


def small_recording(folder: Path) -> StandIn:
    """A recorded run of the phantom with small images, run.mcap: 117 steps."""
    shutil.copy(ROOT / "tests/replay/golden/wrong_place_then_hit.mcap", folder / "run.mcap")
    return StandIn()


def repository(folder: Path) -> StandIn:
    """Files of a clone: examples/ and rig/."""
    for name in ("examples", "rig"):
        (folder / name).symlink_to(ROOT / name)
    return StandIn()


def contact(folder: Path) -> StandIn:
    """A golden recording, run.mcap: the needle touches the retina beside the target, then hits it."""
    shutil.copy(GOLDEN / "wrong_place_then_hit.mcap", folder / "run.mcap")
    return StandIn()


def bent(folder: Path) -> StandIn:
    """A golden recording with a robot, run.mcap."""
    shutil.copy(GOLDEN / "bent_needle.mcap", folder / "run.mcap")
    return StandIn()


def short_recording(folder: Path) -> StandIn:
    """Eight seconds of a phantom in small images, run.mcap."""
    path, scenario = folder / "run.mcap", folder / ".quick.toml"
    path.unlink(missing_ok=True)
    shutil.copy(ROOT / "tests" / "data" / "quick.toml", scenario)
    settings = [f"source.uri=phantom:{scenario}", "run.realtime=false", f"recording.path={path}"]
    haptigraph.build(haptigraph.load_config(settings=settings)).run()
    return StandIn()


def recordings(folder: Path) -> StandIn:
    """A folder of golden recordings, recordings/."""
    (folder / "recordings").mkdir()
    for name in ("align_then_approach", "wrong_place_then_hit"):
        shutil.copy(GOLDEN / f"{name}.mcap", folder / "recordings")
    return StandIn()


def study(folder: Path) -> StandIn:
    """A study, my-study/, whose data come from two simulated participants."""
    subprocess.run(["haptigraph", "study", "new", "my-study"], cwd=folder, env=ENVIRONMENT, check=True)
    command = ["haptigraph", "study", "simulate", "my-study", "--participants", "2", "--workers", "1"]
    subprocess.run(command, cwd=folder, env=ENVIRONMENT, check=True)
    return StandIn()


def answers(folder: Path) -> StandIn:
    """A participant who answers every question of a program."""

    def answer(prompt: str) -> str:
        choice = re.search(r"one of ([^,)]+)", prompt)
        return choice[1] if choice else "3" if "scale" in prompt or "whole number" in prompt else "20"

    before, builtins.input = builtins.input, answer
    return StandIn(stop=lambda: setattr(builtins, "input", before))


def fast(folder: Path) -> StandIn:
    """The demo as fast as possible: the same steps, on a machine that may be busy."""
    return StandIn(replaced={"haptigraph demo": "haptigraph demo --fast"})
