"""`register --rig`: the design of a set-up as a prior, and how far a registration is from it."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from haptigraph.analysis.registering import registering
from haptigraph.cli import main
from haptigraph.imaging import Turn
from haptigraph.messages import Image
from haptigraph.registration.loading import load_camera_registration
from haptigraph.rig.description import load_rig
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

pytestmark = pytest.mark.usefixtures("anatomy_once")

RIG_FILE = Path(__file__).parents[3] / "rig" / "d405.toml"
RIG = load_rig(RIG_FILE)
CENTER_PX, PX_PER_MM = (639.5, 359.5), RIG.camera.focal_px / RIG.path_mm


def picture(center_px=CENTER_PX, px_per_mm=PX_PER_MM, **eye: float) -> Image:
    """One image of the simulated eye as the rig's camera sees it; the needle is outside."""
    scenario = load_scenario("align_then_approach")
    camera = replace(
        scenario.camera, center_px=center_px, px_per_mm=px_per_mm, distance_mm=RIG.path_mm, blur_px=0.6
    )
    shape = replace(
        scenario.eye, wall_mm=RIG.eye.wall_mm, rim_mm=RIG.eye.cut_mm, target_deg=RIG.eye.target_deg, **eye
    )
    moment = Phantom(replace(scenario, camera=camera, eye=shape)).advance()
    assert moment is not None
    return moment.image


@pytest.fixture(scope="module")
def sound() -> Image:
    return picture()


def register(tmp_path: Path, image: Image, *options: str, rig: Path | None = RIG_FILE):
    source, output = tmp_path / "eye.png", tmp_path / "eye.toml"
    cv2.imwrite(str(source), image)
    design = ["--rig", str(rig)] if rig else []
    command = [
        "register",
        str(source),
        "-o",
        str(output),
        "--picture",
        str(tmp_path / "drawn.png"),
        "--force",
    ]
    result = CliRunner().invoke(main, [*command, *design, *options])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result, output


def refused(tmp_path: Path, image: Image, *options: str, rig: Path = RIG_FILE) -> str:
    result, output = register(tmp_path, image, *options, rig=rig)
    assert result.exit_code == 2, result.output
    assert not output.exists()
    (line,) = result.stderr.strip().splitlines()
    return line


def test_nothing_is_assumed_that_the_design_states(tmp_path, sound):
    result, output = register(tmp_path, sound)
    assert result.exit_code == 0, result.output
    found = load_camera_registration(output)

    assert found.assumed == ()
    assert math.dist(found.image.center_px, CENTER_PX) < 1.0
    assert 1 / found.image.mm_per_px == pytest.approx(PX_PER_MM, rel=0.01)
    angle = math.radians(RIG.eye.target_deg)
    assert found.target.at_mm == pytest.approx((12 * math.sin(angle), -12 * math.cos(angle)), abs=0.15)
    angle, middle_mm = math.radians(36), 12.9
    assert found.trocar.at_mm == pytest.approx(
        (middle_mm * math.sin(angle), middle_mm * math.cos(angle)), abs=0.25
    )
    assert "WARNING" not in result.output and "ASSUMED" not in result.output
    assert "larger in the picture than in the needle's plane, by the design" in result.output


def turned(image: Image, clockwise_deg: float) -> Image:
    rotation = cv2.getRotationMatrix2D(CENTER_PX, -clockwise_deg, 1.0)
    return np.asarray(cv2.warpAffine(image, rotation, image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE))


def without_opening(image: Image, angle_deg: float) -> Image:
    hidden = np.zeros(image.shape[:2], np.uint8)
    cv2.ellipse(hidden, (640, 360), (93, 93), 0, angle_deg - 97, angle_deg - 83, 255, 9)
    return np.asarray(cv2.inpaint(image, hidden, 3, cv2.INPAINT_TELEA))


def angles_deg(file: Path) -> tuple[float, float, float]:
    """Trocar in use and the other one, clockwise in the image from the top, and the target, from the bottom."""
    found = load_camera_registration(file)
    trocars = found.trocar, *found.other_trocars
    (x_mm, y_mm), ports_mm = found.target.at_mm, [trocar.at_mm for trocar in trocars]
    used_deg, other_deg = (math.degrees(math.atan2(-right_mm, up_mm)) for right_mm, up_mm in ports_mm)
    return used_deg, other_deg, math.degrees(math.atan2(x_mm, -y_mm))


def test_ports_that_are_found_turn_the_target_as_well(tmp_path, sound):
    result, output = register(tmp_path, turned(sound, 1.5))

    assert result.exit_code == 0, result.output
    assert angles_deg(output) == pytest.approx((-34.5, 37.5, 10.5), abs=0.4)
    assert result.output.count("along the wall") == 2
    assert "WARNING" not in result.output


def test_one_port_turns_the_others_as_far_as_their_turn_is_shared(tmp_path, sound):
    result, output = register(tmp_path, turned(without_opening(sound, 36), 1.5))

    assert result.exit_code == 0, result.output
    used_deg, other_deg, target_deg = angles_deg(output)
    assert used_deg == pytest.approx(-34.8, abs=0.4)
    assert 0.7 < other_deg - 36 < used_deg + 36
    assert target_deg - 9 == pytest.approx(other_deg - 36, abs=0.1)
    assert "right, in use" in result.output and "left: " in result.output
    assert "from the design: no picture shows it" in result.output


def test_without_the_design_the_same_picture_leaves_much_assumed_or_is_refused(tmp_path, sound):
    result, output = register(tmp_path, sound, "--trocar", "578,275", rig=None)

    assert result.exit_code == 0, result.output
    assert {"target", "scale", "mirror"} <= set(load_camera_registration(output).assumed)


def test_the_users_target_and_trocar_come_before_the_designs(tmp_path, sound):
    result, output = register(tmp_path, sound, "--target-mm", "-3", "--trocar", "left")

    found = load_camera_registration(output)
    x_mm, y_mm = found.target.at_mm
    assert math.atan2(x_mm, -y_mm) * 12 == pytest.approx(-3, abs=0.05)
    assert found.trocar.at_mm[0] < 0
    assert "target at its designed angle" not in result.output


@pytest.mark.parametrize(
    ("view", "named", "cause"),
    [
        ({"center_px": (639.5 + 60, 359.5)}, "centre", "turned by 5.1 deg, the mirror by 2.5 deg"),
        pytest.param(
            *({"px_per_mm": PX_PER_MM * 1.08}, "scale", "6.2 mm nearer than designed"), marks=pytest.mark.slow
        ),
        ({"px_per_mm": PX_PER_MM * 0.9}, "scale", "mm farther away than designed"),
    ],
)
def test_a_rig_beyond_its_tolerances_is_registered_with_a_warning_that_names_the_cause(
    tmp_path, view, named, cause
):
    result, output = register(tmp_path, picture(**view))

    assert result.exit_code == 0, result.output
    (warning,) = (line for line in result.output.splitlines() if line.startswith("WARNING"))
    assert warning.startswith(f"WARNING    {named} ")
    if "nearer" not in cause:
        assert cause in warning
    else:
        assert float(warning.split("likely the camera is ")[1].split()[0]) == pytest.approx(6.2, abs=0.6)
    found = load_camera_registration(output)
    assert math.dist(found.image.center_px, view.get("center_px", CENTER_PX)) < 1.5
    assert 1 / found.image.mm_per_px == pytest.approx(view.get("px_per_mm", PX_PER_MM), rel=0.012)


def test_a_circle_that_is_no_eye_does_not_distract_from_where_the_eye_must_be(tmp_path, sound):
    image = sound.copy()
    for radius in (150, 172):  # complete, of high contrast, and larger
        cv2.circle(image, (1080, 360), radius, (255, 255, 255), 6, cv2.LINE_AA)
        cv2.circle(image, (1080, 360), radius - 6, (0, 0, 0), 6, cv2.LINE_AA)

    result, output = register(tmp_path, image)

    assert result.exit_code == 0, result.output
    assert math.dist(load_camera_registration(output).image.center_px, CENTER_PX) < 1.0


def test_what_contradicts_the_design_is_refused(tmp_path, sound):
    assert "contradicts the rig, whose eye has 24 mm" in refused(tmp_path, sound, "--diameter-mm", "23")
    assert "the rig's images are mirrored" in refused(tmp_path, sound, "--not-mirrored")
    assert "does not go with --rig" in refused(tmp_path, sound, "--set", "source.mirror=true")
    half = np.ascontiguousarray(sound[::2, ::2])
    assert "are 640 x 360 px, but the rig's camera takes 1280 x 720 px" in refused(tmp_path, half)


def test_a_recording_of_turned_images_is_refused_as_their_source_is(tmp_path, sound, monkeypatch):
    monkeypatch.setattr(registering, "recorded_turn", lambda uri: Turn(0, mirror=True))

    assert "source.mirror=true does not go with --rig" in refused(tmp_path, sound)


def test_a_camera_that_is_mounted_upside_down_is_turned_by_its_source(tmp_path, sound):
    result, output = register(tmp_path, cv2.rotate(sound, cv2.ROTATE_180), "--set", "source.rotate_deg=180")

    assert result.exit_code == 0, result.output
    assert math.dist(load_camera_registration(output).image.center_px, CENTER_PX) < 1.0


def test_a_rig_that_is_no_rig_is_refused_before_anything_is_read(tmp_path, sound):
    file = tmp_path / "rig.toml"
    file.write_text(RIG_FILE.read_text().replace("f_number = 2.0", "f_number = -2.0"))

    assert "f_number" in refused(tmp_path, sound, rig=file)
    assert "B-scans have no rig" in (
        CliRunner().invoke(main, ["register", "oct:x", "-o", str(file), "--rig", str(RIG_FILE)]).stderr
    )
