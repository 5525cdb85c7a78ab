from typing import get_type_hints

import pytest

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.sim.eye.camera import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Look
from haptigraph.sim.scenario import BOUNDS, load_scenario

MOVE = "[[move]]\nduration_s = 1\ndepth_mm = 0\ntheta_deg = 0\n"


def refuse(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(BadInput) as refused:
        load_scenario(str(file))
    message = str(refused.value)
    assert message.startswith(f"{file}, line ")
    assert "\n" not in message
    return message.removeprefix(f"{file}, ")


@pytest.mark.parametrize(
    ("table", "line", "told"),
    [
        ("scenario", "rate_hz = 1e-300", "scenario.rate_hz: expected float >= 0.1, found 1e-300"),
        ("scenario", "seed = -1", "scenario.seed: expected int >= 0, found -1"),
        ("camera", "width_px = 0", "camera.width_px: expected 64 to 4096, found 0"),
        ("camera", "center_px = [100.0, 1e9]", "camera.center_px: expected 0 to 4096, found (100.0, 1000000000.0)"),
        ("camera", "px_per_mm = 0", "camera.px_per_mm: expected 1 to 100, found 0"),
        ("camera", "blur_px = -1", "camera.blur_px: expected 0 to 50, found -1"),
        ("camera", "blur_px = nan", "camera.blur_px: expected a finite number, found nan"),
        ("needle", "tip_diameter_mm = 0", "needle.tip_diameter_mm: expected 0.01 to 3, found 0"),
        ("needle", "taper_mm = 0", "needle.taper_mm: expected 0.01 to 100, found 0"),
        ("needle", "length_mm = 1e9", "needle.length_mm: expected 1 to 100, found 1000000000.0"),
        ("look", "texture = -1", "look.texture: expected 0 to 10, found -1"),
        ("eye", "diameter_mm = 2", "eye.diameter_mm: expected float >= 15.0, found 2"),
        ("eye", "wall_mm = -1", "eye.wall_mm: expected float >= 0.1, found -1"),
        ("robot", "speed_limit_mm_s = 0", "robot.speed_limit_mm_s: expected float > 0.0, found 0"),
        ("robot", "depth_min_mm = 30", "depth_min_mm 30 lies above depth_max_mm 26"),
        ("operator", "tremor_low_hz = 13", "tremor_low_hz 13 lies above tremor_high_hz 12"),
        ("operator", "tremor_rms_mm = -1", "operator.tremor_rms_mm: expected float >= 0.0, found -1"),
    ],
)  # fmt: skip
def test_values_that_cannot_be_are_one_sentence_with_their_line(tmp_path, table, line, told):
    head = '[scenario]\nsays = "x"\n'
    text = head + (f"{line}\n" if table == "scenario" else f"[{table}]\n{line}\n") + MOVE
    message = refuse(tmp_path, text)
    assert told in message
    number = text.splitlines().index(line) + 1
    assert message.startswith(f"line {number}: ")


@pytest.mark.parametrize("line", ["duration_s = 1e9", "depth_mm = 1e9", "theta_deg = -400"])
def test_moves_that_cannot_be_are_refused(tmp_path, line):
    key = line.split()[0]
    changed = "\n".join(line if other.startswith(key) else other for other in MOVE.splitlines())
    assert f"move[1].{key}: expected float" in refuse(tmp_path, f'[scenario]\nsays = "x"\n{MOVE}{changed}\n')


def test_every_number_that_is_drawn_has_bounds():
    for table, struct in (("camera", CameraSettings), ("needle", NeedleShape), ("look", Look)):
        for key, hint in get_type_hints(struct, include_extras=True).items():
            is_number = hint in (int, float, Vec)
            assert not is_number or f"{table}.{key}" in BOUNDS, f"{table}.{key}"
