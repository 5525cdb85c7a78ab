"""What a reader has and this machine has not: a clip, a recording, a board at a serial port.

A page names them in `<!-- given NAME -->`. Each is as real as this machine allows: the clip is a video
file, the board answers Firmata at a pseudo-terminal.
"""

import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import cv2

import haptigraph
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.errors import EndOfSource

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "support" / "boards")]

from firmata_board import Board  # noqa: E402 - in that folder

CLIP = """
[scenario]
description = "The needle touches the retina beside the target, retracts, is aligned, and hits the target."
[appearance]
style = "light"
[eye]
target_deg = 6.0
trocar_deg = -36.0
"""
CLIP += "".join(
    f"[[move]]\nduration_s = {duration_s}\ndepth_mm = {depth_mm}\ntheta_deg = {theta_deg}\n"
    for duration_s, depth_mm, theta_deg in (
        *((0.5, -3.0, -2.0), (1.5, 8.0, -4.5), (2.5, 21.0, -6.3), (1.2, 22.9, -6.4), (0.5, 22.9, -6.4)),
        *((1.3, 16.0, -5.5), (1.5, 14.5, 0.0), (3.0, 23.8, 0.0), (1.5, 23.8, 0.0)),
    )
)


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """What stands in: texts of the page and what to run instead, and how to stop it."""

    replaced: Mapping[str, str] = field(default_factory=dict)
    stop: Callable[[], object] = lambda: None


def clip(folder: Path) -> StandIn:
    """A video file, clip.mp4, of a simulated eye: a needle touches the retina, then hits the target."""
    scenario = folder / ".clip.toml"
    scenario.write_text(CLIP, encoding="utf-8")
    source = open_source(haptigraph.load_config(settings=[f"source.uri=phantom:{scenario}"]), VirtualClock())
    size_px = source.read(1).image.shape[1::-1]
    writer = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, size_px)
    with suppress(EndOfSource):
        while True:
            writer.write(source.read(1).image)
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


def fast(folder: Path) -> StandIn:
    """The demo as fast as possible: the same steps, on a machine that may be busy."""
    return StandIn(replaced={"haptigraph demo": "haptigraph demo --fast"})


STAND_INS: dict[str, Callable[[Path], StandIn]] = {
    "clip": clip,
    "recording": recording,
    "arduino": arduino,
    "fast": fast,
}
