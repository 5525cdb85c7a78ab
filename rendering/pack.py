"""Pack the raw images of a scene into a labelled clip: `python -m rendering.pack NAME`.

Adds a camera's blur, noise and H.264 compression.
"""

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import av
import cv2
import numpy as np

from haptigraph import assemble
from haptigraph.analysis.evaluation.ground_truth import truth_text
from haptigraph.errors import BadInput
from haptigraph.messages import Image
from rendering.labels import registration_of, truth_of
from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.raw import BACKGROUND, raw_files
from rendering.scene import output_folder, scene_from_arguments

__all__ = ["AWAY_IMAGES", "RATE_HZ", "Sensor", "main", "pack", "write_clip"]

AWAY_IMAGES = 3
"""Number of images without needle at the start."""
RATE_HZ = 30
QUALITY = "15"  # x264's constant rate factor
BLUR_PX = 0.6
NOISE_GREY = 1.3
GREY_SHARE, COLOR_SHARE = 0.8, 0.5  # of the noise: common to all colours, and independent
DARK_SHARE = 0.6  # of the noise in black
PROCEDURE = "subretinal_injection"


def main() -> None:
    """Pack one scene."""
    name, scene = scene_from_arguments(sys.argv[1:])
    folder = output_folder(name)
    try:
        pack(Layout(scene), folder / "raw", folder)
    except BadInput as error:
        print(f"rendering: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(f"{name}: packed into {folder}")


def pack(layout: Layout, raw: Path, folder: Path) -> None:
    """Write clip.mp4, empty.png, registration.toml and truth.csv.

    Args:
        layout: Layout of the scene.
        raw: Folder of its raw images.
        folder: Folder of the clip.

    Raises:
        BadInput: If a raw image is missing.
    """
    files, sensor = raw_files(raw, layout.poses), Sensor(layout.scene.seed)
    background = _read(raw / BACKGROUND)
    missing = [file for file in files if not file.exists()]
    if missing:
        raise _not_rendered(missing[0])
    write_clip(folder / "clip.mp4", (sensor(image) for image in _images(layout, background, files)))
    cv2.imwrite(str(folder / BACKGROUND), sensor(background))
    truth = truth_of(layout, [None] * AWAY_IMAGES + list(layout.poses), assemble.load_procedure(PROCEDURE))
    (folder / "registration.toml").write_text(registration_of(layout))
    (folder / "truth.csv").write_text(truth_text(truth, RATE_HZ))


class Sensor:
    """Simulate a camera's blur and sensor noise.

    Args:
        seed: Seed of the noise.
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def __call__(self, image: Image) -> Image:
        """Return an image, slightly blurred, with noise that increases with brightness."""
        blurred = cv2.GaussianBlur(image, (0, 0), BLUR_PX).astype(np.float32)
        grey = self._random.normal(0, GREY_SHARE, blurred.shape[:2])
        colored = self._random.normal(0, COLOR_SHARE, blurred.shape)
        noise = NOISE_GREY * (grey[..., None] + colored) * (DARK_SHARE + blurred / 255)
        return np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)


def _images(layout: Layout, background: Image, files: Sequence[Path]) -> Iterator[Image]:
    """Yield the background image several times, then with the rendered region of each image in it."""
    for _ in range(AWAY_IMAGES):
        yield background
    left, top, right, bottom = layout.changing_px()
    rendered = np.s_[top : bottom - 1, left + 1 : right - 1]  # Blender may round the region's edges inwards
    for file in files:
        image = background.copy()
        image[rendered] = _read(file)[rendered]
        yield image


def _read(file: Path) -> Image:
    """Read a raw image, BGR."""
    try:
        with av.open(str(file)) as container:
            (image,) = container.decode(video=0)
            return np.asarray(image.to_ndarray(format="bgr24"), np.uint8)
    except (av.FFmpegError, ValueError):
        raise _not_rendered(file) from None


def _not_rendered(file: Path) -> BadInput:
    return BadInput("is not an image; delete it if it exists, and run: make render", file)


def write_clip(file: Path, images: Iterable[Image]) -> None:
    """Encode BGR images as H.264.

    Args:
        file: The MP4 file to write.
        images: (HEIGHT_PX, WIDTH_PX, 3) each.
    """
    with av.open(str(file), "w") as container:
        stream = container.add_stream("libx264", rate=RATE_HZ, options={"crf": QUALITY})
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


if __name__ == "__main__":
    main()
