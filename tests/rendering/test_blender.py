"""In Blender, if `make render` has installed it."""

import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from paths import ROOT

from rendering.layout import Layout
from rendering.scene import load_scene, scene_file

BLENDER = ROOT / ".venv-rendering"
NAME, NUMBER, SMALLER = "black_blunt", 28, 4
SMALL = """
import sys
from pathlib import Path

import bpy

from rendering.layout import Layout
from rendering.scene import load_scene, scene_file
from rendering.stage import Stage

name, number, smaller, folder = sys.argv[1:]
layout = Layout(load_scene(scene_file(name)))
stage = Stage(layout)
bpy.context.scene.cycles.samples = 2
pose, box_px = layout.poses[int(number)], layout.changing_px()
stage.render(Path(folder) / "empty.png", None, None, int(smaller))
stage.render(Path(folder) / "needle.png", pose, box_px, int(smaller))
stage.render(Path(folder) / "part.webp", pose, (0, 0, 640, 320), int(smaller))
"""


IMPORTED = """
import sys
from importlib.metadata import packages_distributions
from unittest.mock import MagicMock

before = set(sys.modules)
sys.modules |= dict.fromkeys(("bpy", "bmesh", "mathutils"), MagicMock())
import rendering.render
import rendering.render_tips

tops = {name.partition(".")[0] for name in set(sys.modules) - before}
print(*sorted({name for top in tops for name in packages_distributions().get(top, ())}))
"""


@pytest.mark.slow
def test_everything_that_rendering_imports_is_in_its_requirements():
    done = subprocess.run([sys.executable, "-c", IMPORTED], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    listed = re.findall(r"^[\w-]+", (ROOT / "rendering" / "requirements.txt").read_text(), re.MULTILINE)
    brought = {
        "haptigraph",
        "numpy",
        "typing_extensions",
    }  # bpy requires NumPy; msgspec can do without the last
    assert {*done.stdout.split()} - brought <= {*listed}


def grey(image, at_px):
    """Brightness of a reduced image at a point of the full one."""
    x, y = (round((value + 0.5) / SMALLER - 0.5) for value in at_px)
    return float(image[y, x])


@pytest.mark.slow
@pytest.mark.skipif(
    not (BLENDER / "ready").exists(), reason="no Blender in .venv-rendering; make render puts it there"
)
def test_blender_renders_the_needle_at_the_position_of_the_layout(tmp_path):
    command = [BLENDER / "bin" / "python", "-c", SMALL, NAME, str(NUMBER), str(SMALLER), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""  # Blender's own lines are suppressed
    background, needle = (
        cv2.imread(str(tmp_path / f"{name}.png"), cv2.IMREAD_GRAYSCALE) for name in ("empty", "needle")
    )
    assert background.shape == needle.shape == (180, 320)
    layout = Layout(load_scene(scene_file(NAME)))
    pose = layout.poses[NUMBER]
    tip_mm, direction = layout.placed(pose).tip_mm, layout.placed(pose).direction
    for ahead_mm, is_needle in ((-8.0, True), (-3.0, True), (-0.7, True), (0.7, False)):
        at_px = layout.to_px(tuple(np.add(tip_mm, np.multiply(ahead_mm, direction))))
        assert (grey(background, at_px) - grey(needle, at_px) > 60) == is_needle, ahead_mm
    left, _, right, bottom = (round(edge / SMALLER) for edge in layout.changing_px())
    for beyond in np.s_[:, : left - 1], np.s_[:, right + 1 :], np.s_[bottom + 1 :]:
        assert needle[beyond].max() <= 1  # black, dithered
        assert background[beyond].max() > 60
    part = cv2.imread(str(tmp_path / "part.webp"), cv2.IMREAD_GRAYSCALE)
    assert part.shape == (80, 160)
    assert np.abs(part.astype(float) - needle[:80, :160])[1:-1, left + 1 : -1].mean() < 3
