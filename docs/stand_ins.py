"""What a reader has and this machine has not: a clip, a recording, a camera, a board at a serial port.

A page names them in `<!-- given NAME -->`. Each is as real as this machine allows: the clip is a video
file, the board answers Firmata at a pseudo-terminal.
"""

import builtins
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from shutil import copyfile

import cv2
import numpy as np
from msgspec.structs import replace
from pydicom.dataset import Dataset

import haptigraph
from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.rig.description import load_rig
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.reading import read_images

ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "tests" / "replay" / "golden"
SUPPORT = ROOT / "tests" / "support"
sys.path += [
    *(str(folder) for folder in (SUPPORT, SUPPORT / "boards", SUPPORT / "force")),
    *(str(folder) for folder in (ROOT / "tests" / "ros2", ROOT / "benchmarks")),
]

from dicom_files import dicom, write  # noqa: E402 - in these folders
from firmata_board import Board  # noqa: E402
from haptic_driver import DriverBoard  # noqa: E402
from inverse_service import Service, serving  # noqa: E402
from lens import BOARD, SheetCamera, simulated_lens  # noqa: E402
from onnx_files import grey_steps_net  # noqa: E402
from ros_bags import images_bag  # noqa: E402
from streaming import StreamingCamera  # noqa: E402

ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """What stands in: texts of the page and what to run instead, and how to stop it."""

    replaced: Mapping[str, str] = field(default_factory=dict)
    stop: Callable[[], object] = lambda: None


def clip(folder: Path) -> StandIn:
    """A video file, clip.mp4, of a simulated eye, ten seconds."""
    phantom = Phantom(load_scenario("align_then_approach"))
    write_video(folder / "clip.mp4", (moment.image for moment in moments(phantom, 300)))
    return StandIn()


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
    copyfile(Path(recorded().name) / "run.mcap", folder / "run.mcap")
    return StandIn()


def small_recording(folder: Path) -> StandIn:
    """A recorded run of the phantom with small images, run.mcap: 117 steps."""
    shutil.copy(ROOT / "tests/replay/golden/wrong_place_then_hit.mcap", folder / "run.mcap")
    return StandIn()


def arduino(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0: it answers as the sketch does, at a pseudo-terminal."""
    board = Board(folder / ".ttyACM0")
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0")}, stop=board.close)


def driver_chip(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0, and a DRV2605L on its I2C bus, EN at pin 7."""
    board = DriverBoard(folder / ".ttyACM0-chip", channels=(), enable_pin=7)
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0-chip")}, stop=board.close)


def driver_chips(folder: Path) -> StandIn:
    """Two DRV2605L, at channels 0 and 1 of a multiplexer, on the I2C bus of a board at /dev/ttyACM0."""
    board = DriverBoard(folder / ".ttyACM0-chips", channels=(0, 1))
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0-chips")}, stop=board.close)


def eye(folder: Path) -> StandIn:
    """The registration of the simulated eye that `clip` and `camera` show, eye.toml."""
    phantom = Phantom(load_scenario("align_then_approach"))
    (folder / "eye.toml").write_text(phantom.registration)
    return StandIn()


def camera(folder: Path) -> StandIn:
    """A camera, camera:0, before a simulated eye: a network camera on this machine streams the images."""
    return streaming(moment.image for moment in moments(Phantom(load_scenario("align_then_approach")), 150))


def sheet(folder: Path) -> StandIn:
    """A camera, camera:0, to which the printed sheet is shown in 40 positions, with a lens that distorts."""
    rng = np.random.default_rng(5)
    shown = SheetCamera(simulated_lens(-0.04, 900.0, rng), BOARD, rng)
    return streaming([shown.picture() for _ in range(40)], rate_hz=5.0)


def streaming(images: Iterable[np.ndarray], rate_hz: float = 30.0) -> StandIn:
    """Stream images again and again."""
    stream = StreamingCamera([cv2.imencode(".jpg", image)[1].tobytes() for image in images], rate_hz)
    return StandIn(replaced={"camera:0": stream.uri}, stop=stream.unplug)


def rig(folder: Path) -> StandIn:
    """The rig of rig/d405.toml, built without any error: this file, also as rig.toml, and a clip."""
    (folder / "rig").mkdir()
    for name in ("rig/d405.toml", "rig.toml"):
        shutil.copy(ROOT / "rig" / "d405.toml", folder / name)
    design, scenario = load_rig(folder / "rig.toml"), load_scenario("align_then_approach")
    seen = replace(
        scenario.camera,
        center_px=(639.5, 359.5),
        px_per_mm=design.camera.focal_px / design.path_mm,
        distance_mm=design.path_mm,
        blur_px=0.6,
    )
    built = replace(
        scenario.eye,
        wall_mm=design.eye.wall_mm,
        rim_mm=design.eye.cut_mm,
        target_deg=design.eye.target_deg,
        hemorrhage_mm=design.eye.target_mm,
        hemorrhage_deg=design.eye.target_deg,
    )
    phantom = Phantom(replace(scenario, camera=seen, eye=built))
    write_video(folder / "clip.mp4", (moment.image for moment in moments(phantom, 200)))
    return StandIn()


def scan(folder: Path) -> StandIn:
    """A simulated B-scan, scan.dcm."""
    pixels, group = Dataset(), Dataset()
    pixels.PixelSpacing = [0.0033, 0.0078]
    group.PixelMeasuresSequence = [pixels]
    images = np.array(captured("phantom:ioct_approach", 1))
    write(folder / "scan.dcm", dicom(images, SharedFunctionalGroupsSequence=[group]))
    return StandIn()


def bscans(folder: Path) -> StandIn:
    """Simulated B-scans: pictures in scans/, and a film of a monitor, monitor.mp4."""
    images = captured("phantom:ioct_approach", 30)
    write_pictures(folder / "scans", images)
    screen = np.full((900, 1400), 40, np.uint8)
    shown = []
    for image in images:
        screen[96:864, 320:1344] = cv2.resize(image, (1024, 768), interpolation=cv2.INTER_LINEAR)
        shown.append(cv2.cvtColor(screen, cv2.COLOR_GRAY2BGR))
    write_video(folder / "monitor.mp4", shown)
    return StandIn()


def network(folder: Path) -> StandIn:
    """A network of four classes beside nets/mine.toml: it knows grey levels only."""
    (folder / "nets").mkdir(exist_ok=True)
    model = grey_steps_net([-0.9, 1.0, -0.2, 0.4], 20.0)
    (folder / "nets" / "mine.onnx").write_bytes(model.SerializeToString())
    return StandIn()


def volumes(folder: Path) -> StandIn:
    """Simulated OCT volumes, volumes/."""
    (folder / "volumes").mkdir()
    for number, image in enumerate(captured("phantom:volume_approach", 5)):
        slices = image.reshape(len(image), 48, -1).swapaxes(0, 1)
        np.save(folder / "volumes" / f"{number:03}.npy", slices)
    return StandIn()


def rosbag(folder: Path) -> StandIn:
    """A ROS 2 bag, surgery/, of a simulated eye."""
    phantom = Phantom(load_scenario("align_then_approach"))
    images_bag(folder / "surgery", [moment.image for moment in moments(phantom, 60)])
    return StandIn()


def inverse3(folder: Path) -> StandIn:
    """A force device, inverse3: the service of its maker, simulated; its button is held."""
    stack, service = ExitStack(), Service()
    stack.enter_context(serving(service))
    service.buttons["a"] = True
    return StandIn(replaced={"inverse3": f"inverse3:{service.address}"}, stop=stack.close)


def moments(phantom: Phantom, count: int) -> list:
    """Return what a simulated camera sees."""
    return list(islice(iter(phantom.advance, None), count))


def captured(uri: str, count: int) -> list[np.ndarray]:
    """Return images of a source."""
    source = open_source(Config(SourceConfig(uri=uri)), VirtualClock())
    return [capture.image for capture in islice(read_images(source), count)]


def write_video(path: Path, images: Iterable[np.ndarray]) -> None:
    """Write a video of 30 images/s."""
    writer = None
    for image in images:
        writer = writer or cv2.VideoWriter(
            str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, image.shape[1::-1]
        )
        writer.write(image)
    if writer:
        writer.release()


def write_pictures(folder: Path, images: Iterable[np.ndarray]) -> None:
    """Write a folder of PNG."""
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number:03}.png"), image)


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
    "small_recording": small_recording,
    "arduino": arduino,
    "driver_chip": driver_chip,
    "driver_chips": driver_chips,
    "eye": eye,
    "camera": camera,
    "sheet": sheet,
    "rig": rig,
    "scan": scan,
    "bscans": bscans,
    "network": network,
    "volumes": volumes,
    "rosbag": rosbag,
    "inverse3": inverse3,
    "repository": repository,
    "contact": contact,
    "bent": bent,
    "short_recording": short_recording,
    "recordings": recordings,
    "study": study,
    "answers": answers,
}
