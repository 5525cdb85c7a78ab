"""Windows from drawn scenes: on painted pictures in place of rendered ones, for Blender is not here."""

import cv2
import numpy as np
import pytest

from haptigraph.perception.native.tip_network import STATIONS, VALUES, WEIGHTS
from rendering import tips
from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.lot import drawn_scene
from rendering.tips import EMPTY, SMALLER, file_of, parts_of, poses_of
from training import tip_rendered
from training.tip_rendered import is_rendered, judged_in, of_drawn
from training.tip_shape import ACROSS, BEHIND, FILE, STEP_MM
from training.tip_windows import VARIANTS

NUMBER = 6


@pytest.fixture(scope="module")
def painted(tmp_path_factory):
    """One scene in two variants, of a bright needle on a dark ground; its number."""
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
        yield NUMBER


@pytest.fixture(scope="module")
def windows(painted):
    return of_drawn(painted)


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


def test_the_shipped_network_is_right_about_the_tips_of_a_plain_needle(painted, windows):
    judged = judged_in(painted, np.load(FILE))
    far, is_far, z = map(np.array, zip(*judged, strict=True))
    assert len(judged) == len(windows.beyond_mm) / 3
    assert np.mean(is_far) < 0.05 and np.median(far) < 0.03
    assert np.all(z >= 0) and np.all(np.isfinite(z))


def test_a_network_that_has_learned_nothing_is_sure_of_nothing(painted):
    judged = judged_in(painted, np.zeros(WEIGHTS, np.float32))
    assert min(far for far, _, _ in judged) > 0.5
