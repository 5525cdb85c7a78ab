"""The raw images of a scene on disk: which there are to be, and whether those that there are still hold.

Knows neither how they are rendered nor what becomes of them.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path

from rendering.path import Pose

__all__ = ["EMPTY", "begin", "missing", "raw_files"]

EMPTY = "empty.png"
"""The image without needle."""


def raw_files(folder: Path, poses: Sequence[Pose]) -> list[Path]:
    """Return the files of the images with the needle in these poses."""
    return [folder / f"{number:04d}.png" for number in range(len(poses))]


def begin(folder: Path, scene: bytes) -> None:
    """Make a folder ready for the images of a scene, as its file has it; those of another are deleted."""
    note = folder / "scene.toml"
    if not note.exists() or note.read_bytes() != scene:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        note.write_bytes(scene)


def missing(folder: Path, poses: Sequence[Pose]) -> dict[Path, Pose | None]:
    """Return the images that are still to be rendered, each with the needle's pose; None: without needle."""
    wanted = {folder / EMPTY: None, **dict(zip(raw_files(folder, poses), poses, strict=True))}
    return {file: pose for file, pose in wanted.items() if not file.exists()}
