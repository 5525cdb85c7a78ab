"""Clips, cameras, OCT and networks: simulated images in real files and streams."""

import shutil
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace
from pydicom.dataset import Dataset

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.rig.description import load_rig
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.reading import read_images

from stand_ins.stand_in import ROOT, StandIn  # isort: skip - sets the path

from dicom_files import dicom, write
from lens import BOARD, SheetCamera, simulated_lens
from onnx_files import grey_steps_net
from ros_bags import images_bag
from streaming import StreamingCamera

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


def clip(folder: Path) -> StandIn:
    """A video file, clip.mp4, of a simulated eye: a needle touches the retina, then hits the target."""
    write_video(folder / "clip.mp4", (moment.image for moment in moments(seen(folder), 405)))
    return StandIn()


def eye(folder: Path) -> StandIn:
    """The registration of the simulated eye that `clip` and `camera` show, eye.toml."""
    (folder / "eye.toml").write_text(seen(folder).registration)
    return StandIn()


def camera(folder: Path) -> StandIn:
    """A camera, camera:0, before a simulated eye: a network camera on this machine streams the images."""
    return streaming(moment.image for moment in moments(seen(folder), 150))


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


def seen(folder: Path) -> Phantom:
    """Return the eye of the clip."""
    scenario = folder / ".clip.toml"
    scenario.write_text(CLIP, encoding="utf-8")
    return Phantom(load_scenario(str(scenario)))
