"""Windows from drawn scenes: on painted pictures in place of rendered ones, for Blender is not here."""

import cv2
import numpy as np
import pytest

from haptigraph.perception.native.tip_network import STATIONS, VALUES
from rendering import tips
from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.lot import drawn_scene
from rendering.tips import EMPTY, SMALLER, file_of, parts_of, poses_of
from training import tip_rendered
from training.tip_rendered import is_rendered, of_drawn
from training.tip_shape import ACROSS, BEHIND, STEP_MM
from training.tip_windows import VARIANTS

NUMBER = 6


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    """Those of one scene in two variants, of a bright needle on a dark ground."""
    with pytest.MonkeyPatch.context() as patched:
        folder = tmp_path_factory.mktemp("tips")
        patched.setattr(tips, "FOLDER", folder)
        patched.setattr(tip_rendered, "FOLDER", folder)
        chosen = {name: VARIANTS[name] for name in ("full", "half and noisy")}
        patched.setattr(tip_rendered, "VARIANTS", chosen)
        layout = Layout(drawn_scene(NUMBER))
        ground = np.full((HEIGHT_PX, WIDTH_PX, 3), (40, 50, 60), np.uint8)
        file_of(NUMBER, EMPTY).parent.mkdir()
        for name, (pose, box) in parts_of(layout).items():
            assert not is_rendered(NUMBER)
            image = ground.copy()
            if pose:
                placed = layout.placed(pose)
                ends = layout.to_px(layout.eye.trocar_mm), layout.to_px(placed.tip_mm, placed.behind_mm)
                corners = np.rint(np.array(ends) * 16).astype(np.int32)
                cv2.line(image, corners[0], corners[1], (190, 190, 190), 7, cv2.LINE_AA, 4)
            cv2.imwrite(str(file_of(NUMBER, name)), part(image, box))
        assert is_rendered(NUMBER)
        yield of_drawn(NUMBER)


def part(image, box):
    if box is None:
        return image[::SMALLER, ::SMALLER]
    left, top, right, bottom = box
    return image[top:bottom, left:right]


def test_a_window_at_each_selected_tip_one_near_it_and_one_further_off(windows):
    selected, near, wide = windows.beyond_mm.reshape(-1, 3).T
    assert windows.values.shape == (len(windows.beyond_mm), VALUES)
    assert len(selected) > 0.7 * 2 * len(poses_of(Layout(drawn_scene(NUMBER))))
    assert np.quantile(np.abs(selected), 0.8) < 0.25
    assert np.median(np.abs(near)) > 0.2 and np.max(np.abs(wide)) > 1


def test_a_needle_is_seen_before_its_true_tip_and_not_beyond_at_any_resolution(windows):
    is_near = np.abs(windows.beyond_mm) < 0.8
    rows = windows.values[is_near].astype(float).reshape(-1, 3 * ACROSS + 1, STATIONS)
    shown, stations = np.abs(rows[:, :ACROSS]).mean(axis=1), np.arange(STATIONS)
    ends = BEHIND + windows.beyond_mm[is_near] / STEP_MM
    before = np.array([row[stations < end - 5].mean() for row, end in zip(shown, ends, strict=True)])
    beyond = np.array([row[stations > end + 5].mean() for row, end in zip(shown, ends, strict=True)])
    assert np.mean(before > 2 * beyond) > 0.8
