"""The raw images of a scene on disk: their names, which are missing, and whether the scene has changed."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from rendering.path import Pose

__all__ = ["BACKGROUND", "begin", "missing", "raw_files"]

BACKGROUND = "empty.png"
"""The image without needle."""


def raw_files(folder: Path, poses: Sequence[Pose]) -> list[Path]:
    """Return the files of the images with the needle, one per pose."""
    return [folder / f"{number:04d}.png" for number in range(len(poses))]


def begin(folder: Path, scene: bytes) -> None:
    """Prepare a folder for the images of a scene file; delete those of a different scene."""
    note = folder / "scene.toml"
    if not note.exists() or note.read_bytes() != scene:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        note.write_bytes(scene)


def missing(folder: Path, poses: Sequence[Pose]) -> dict[Path, Pose | None]:
    """Return the images to render, each with the needle's pose; None: without needle."""
    wanted = {folder / BACKGROUND: None, **dict(zip(raw_files(folder, poses), poses, strict=True))}
    return {file: pose for file, pose in wanted.items() if not file.exists()}
