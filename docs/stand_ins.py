"""What a reader has and this machine has not: a clip, a recording, a board at a serial port.

A page names them in `<!-- given NAME -->`. Each is as real as this machine allows: the clip is a video
file, the board answers Firmata at a pseudo-terminal.
"""

import builtins
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import cv2

import haptigraph

ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "tests" / "replay" / "golden"
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "support" / "boards")]

ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}

from firmata_board import Board  # noqa: E402 - in that folder


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """What stands in: texts of the page and what to run instead, and how to stop it."""

    replaced: Mapping[str, str] = field(default_factory=dict)
    stop: Callable[[], object] = lambda: None


def clip(folder: Path) -> StandIn:
    """A video file, clip.mp4, of a simulated eye, ten seconds."""
    config = haptigraph.load_config(settings=["source.uri=phantom:align_then_approach", "run.realtime=false"])
    images = [step.capture.image for step in islice(haptigraph.build(config).steps(), 300)]
    size_px = images[0].shape[1::-1]
    writer = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, size_px)
    for image in images:
        writer.write(image)
    writer.release()
    return StandIn()


def recording(folder: Path) -> StandIn:
    """A recorded run of the phantom, run.mcap."""
    settings = [
        "source.uri=phantom:wrong_place_then_hit",
        "run.realtime=false",
        f"recording.path={folder / 'run.mcap'}",
    ]
    haptigraph.build(haptigraph.load_config(settings=settings)).run()
    return StandIn()


def arduino(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0: it answers as the sketch does, at a pseudo-terminal."""
    board = Board(folder / ".ttyACM0")
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0")}, stop=board.close)


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


STAND_INS: dict[str, Callable[[Path], StandIn]] = {
    "clip": clip,
    "recording": recording,
    "arduino": arduino,
    "repository": repository,
    "contact": contact,
    "bent": bent,
    "short_recording": short_recording,
    "recordings": recordings,
    "study": study,
    "answers": answers,
}
