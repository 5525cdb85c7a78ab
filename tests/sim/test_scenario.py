from typing import get_type_hints

import numpy as np
import pytest
from msgspec.structs import replace
from paths import DATA

from haptigraph.errors import BadInput, RenamedKey
from haptigraph.geometry import Vec
from haptigraph.sim.eye.camera import NeedleShape
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.phantom import Phantom
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
    ("table", "line", "problem"),
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
        ("appearance", "texture = -1", "appearance.texture: expected 0 to 10, found -1"),
        ("eye", "diameter_mm = 2", "eye.diameter_mm: expected float >= 15.0, found 2"),
        ("eye", "wall_mm = -1", "eye.wall_mm: expected float >= 0.1, found -1"),
        ("robot", "speed_limit_mm_s = 0", "robot.speed_limit_mm_s: expected float > 0.0, found 0"),
        ("robot", "depth_min_mm = 30", "depth_min_mm 30 is above depth_max_mm 26"),
        ("operator", "tremor_low_hz = 13", "tremor_low_hz 13 is above tremor_high_hz 12"),
        ("operator", "tremor_rms_mm = -1", "operator.tremor_rms_mm: expected float >= 0.0, found -1"),
    ],
)  # fmt: skip
def test_invalid_values_are_reported_in_one_sentence_with_their_line(tmp_path, table, line, problem):
    head = '[scenario]\ndescription = "x"\n'
    text = head + (f"{line}\n" if table == "scenario" else f"[{table}]\n{line}\n") + MOVE
    message = refuse(tmp_path, text)
    assert problem in message
    number = text.splitlines().index(line) + 1
    assert message.startswith(f"line {number}: ")


@pytest.mark.parametrize("line", ["duration_s = 1e9", "depth_mm = 1e9", "theta_deg = -400"])
def test_invalid_moves_are_refused(tmp_path, line):
    key = line.split()[0]
    changed = "\n".join(line if other.startswith(key) else other for other in MOVE.splitlines())
    assert f"move[1].{key}: expected float" in refuse(
        tmp_path, f'[scenario]\ndescription = "x"\n{MOVE}{changed}\n'
    )


def test_every_number_that_affects_drawing_has_bounds():
    for table, struct in (("camera", CameraSettings), ("needle", NeedleShape), ("appearance", Appearance)):
        for key, hint in get_type_hints(struct, include_extras=True).items():
            is_number = hint in (int, float, Vec)
            assert not is_number or f"{table}.{key}" in BOUNDS, f"{table}.{key}"


# --- keys of version 0.1


def test_a_scenario_of_version_0_1_is_read_with_a_warning_for_each_renamed_key(quick):
    file = str(DATA / "v0_1" / "scenarios" / "quick.toml")
    with pytest.warns(RenamedKey) as warned:
        old = load_scenario(file)
    assert sorted(str(warning.message) for warning in warned) == [
        f"{file}, line 13: key 'look' is now called 'appearance'",
        f"{file}, line 2: key 'says' is now called 'description'",
        f"{file}, line 60: key 'glints' is now called 'specular_highlights'",
    ]
    new = load_scenario(quick)
    distractors = Distractors(specular_highlights=3)
    assert old == replace(
        new, about=replace(new.about, description=old.about.description), distractors=distractors
    )
    before, after = (Phantom(scenario).advance() for scenario in (old, replace(new, distractors=distractors)))
    assert np.array_equal(before.image, after.image)


def test_old_keys_work_in_nested_tables_and_errors_name_their_line(tmp_path):
    file = tmp_path / "mine.toml"
    head = f'[scenario]\ndescription = "x"\n{MOVE}'
    file.write_text(f"{head}[distractors]\nglints = 3\n")
    with pytest.warns(RenamedKey, match="'glints' is now called 'specular_highlights'"):
        assert load_scenario(str(file)).distractors.specular_highlights == 3
    file.write_text(f"{head}[look]\ntexure = 1\n")
    with pytest.warns(RenamedKey), pytest.raises(BadInput, match="line 8: unknown key 'texure'"):
        load_scenario(str(file))
    file.write_text(f"{head}[look]\n[appearance]\n")
    with pytest.raises(BadInput, match="both 'look' and 'appearance'"):
        load_scenario(str(file))
