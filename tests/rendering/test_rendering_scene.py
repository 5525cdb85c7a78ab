import pytest

from haptigraph.errors import BadInput
from rendering.scene import load_scene, scene_file, scene_from_arguments, scene_names

GOOD = """
says = "x"
seed = 1
trocar = "first"
target_deg = 0
start_deg = 6
[camera]
px_per_mm = 20
globe_mm = [0.0, -2.0]
[bowl]
color = [0.5, 0.5, 0.5]
rim_color = [0.5, 0.5, 0.5]
[needle]
point = "cone"
width_mm = 0.5
taper_mm = 5
[[light]]
towards = [0, -1, 1]
size_mm = 20
"""
CONE = 'point = "cone"\nwidth_mm = 0.5\ntaper_mm = 5'


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_is_valid_and_has_a_description(name):
    assert load_scene(scene_file(name)).description.endswith(".")


def test_the_scenes_of_the_docs_exist():
    names = {
        "bright_bowl",
        "dark_bowl_bevel",
        "grey_bowl",
        "second_instrument",
        "black_blunt",
        "soft_picture",
    }
    assert names <= set(scene_names())


def test_no_two_scenes_have_the_same_noise():
    seeds = [load_scene(scene_file(name)).seed for name in scene_names()]
    assert len(set(seeds)) == len(seeds)


@pytest.mark.parametrize(
    ("was", "becomes", "expected"),
    [
        ("width_mm = 0.5", "width_mm = 5", "line 15: needle.width_mm: expected `float` <= 1.0, found 5"),
        ("width_mm = 0.5", "width = 0.5", "line 15: unknown key 'width'; did you mean 'width_mm'?"),
        ("width_mm = 0.5", "", "needle: key 'width_mm' is missing"),
        ('trocar = "first"', 'trocar = "third"', "line 4: unknown trocar 'third'; valid: first, second"),
        ("taper_mm = 5", "", "line 14: needle: key 'taper_mm' is missing; point 'cone' needs it"),
        ('point = "cone"', 'point = "blunt"', "line 16: needle.taper_mm: goes with point 'cone' only, found"),
        (
            CONE,
            'point = "bevel"\nwidth_mm = 0.5',
            "needle: key 'roll_deg' is missing; point 'bevel' needs it",
        ),
        ("[0.5, 0.5, 0.5]", "[0.5, 0.5, 1.5]", "bowl.color[2]: expected `float` <= 1.0, found 1.5"),
        ("[0, -1, 1]", "[0, 0, 0]", "line 18: light[0].towards: expected a direction"),
        ("seed = 1", "seed = ", "not valid TOML"),
    ],
)
def test_an_invalid_scene_is_refused_in_one_sentence_with_its_line(tmp_path, was, becomes, expected):
    file = tmp_path / "scene.toml"
    file.write_text(GOOD)
    load_scene(file)
    file.write_text(GOOD.replace(was, becomes, 1))
    with pytest.raises(BadInput) as refused:
        load_scene(file)
    assert str(refused.value).startswith(f"{file}, ")
    assert expected.replace("`", "") in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_scene_without_light_is_refused(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text("light = []\n" + GOOD.partition("[[light]]")[0])
    with pytest.raises(BadInput, match=r"line 1: light: found none; .* at least one \[\[light\]\]"):
        load_scene(file)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["grey_bowel"], "unknown scene 'grey_bowel'; did you mean 'grey_bowl'?"),
        ([], "expected the name of one scene, found 0"),
        (["grey_bowl", "soft_picture"], "expected the name of one scene, found 2"),
    ],
)
def test_an_invalid_command_line_exits_with_code_2_and_a_sentence(capsys, arguments, expected):
    with pytest.raises(SystemExit) as ended:
        scene_from_arguments(arguments)
    assert ended.value.code == 2
    assert expected in capsys.readouterr().err
