"""rig.toml: what it describes, and which files are refused."""

import math
from pathlib import Path

import pytest

from haptigraph.errors import BadInput
from haptigraph.rig.description import load_rig, parse_rig

D405 = Path(__file__).parents[2] / "rig" / "d405.toml"


def test_the_shipped_rig_has_one_mirror_and_its_path_ends_at_the_pupil():
    rig = load_rig(D405)

    assert rig.mirrored
    assert rig.path_mm == pytest.approx(35 + 45 + 3.7)
    assert rig.camera.focal_px == pytest.approx(640 / math.tan(math.radians(43.5)))


def test_a_camera_that_faces_the_eye_sees_it_unmirrored():
    text = D405.read_text().split("[[mirror]]")[0].replace("[camera]", "direct_mm = 90.0\n[camera]")

    rig = parse_rig(text, "rig.toml")

    assert not rig.mirrored
    assert rig.path_mm == pytest.approx(93.7)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[camera]", "direct_mm = 90.0\n[camera]", "either a \\[\\[mirror\\]\\] or direct_mm"),
        ("[[mirror]]", "[[mirror]]\nfrom_section_mm = 9.0\nto_camera_mm = 9.0\n[[mirror]]", "2 mirrors"),
        ("format = 1", "format = 2", "format"),
        ("f_number = 2.0", "f_number = 0.0", "f_number"),
        ("pupil_mm", "pupill_mm", "unknown key"),
    ],
)
def test_a_rig_that_is_not_valid_is_refused_with_its_line(old, new, sentence):
    with pytest.raises(BadInput, match=sentence) as refused:
        parse_rig(D405.read_text().replace(old, new, 1), "rig.toml")

    assert "rig.toml" in str(refused.value)
