"""What a reader has and this machine has not: a clip, a recording, a board at a serial port.

A page names them in `<!-- given NAME -->`. Each is as real as this machine allows: the clip is a video
file, the board answers Firmata at a pseudo-terminal.
"""

import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import cv2

import haptigraph

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "support" / "boards")]

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


def small_recording(folder: Path) -> StandIn:
    """A recorded run of the phantom with small images, run.mcap: 117 steps."""
    shutil.copy(ROOT / "tests/replay/golden/wrong_place_then_hit.mcap", folder / "run.mcap")
    return StandIn()


def arduino(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0: it answers as the sketch does, at a pseudo-terminal."""
    board = Board(folder / ".ttyACM0")
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0")}, stop=board.close)


STAND_INS: dict[str, Callable[[Path], StandIn]] = {
    "clip": clip,
    "recording": recording,
    "small_recording": small_recording,
    "arduino": arduino,
}
