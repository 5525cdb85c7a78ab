import re

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import distance_to_polyline, norm, subtract
from haptigraph.lens import Lens
from haptigraph.projection import LensMap
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import load_camera_registration, parse_camera_registration
from haptigraph.registration.text import registration_text


def changed(text: str, pattern: str, replacement: str) -> str:
    new, count = re.subn(pattern, replacement, text, count=1, flags=re.MULTILINE)
    assert count == 1
    return new


def refuse(text: str) -> str:
    with pytest.raises(BadInput) as refused:
        parse_camera_registration(text, "eye.toml")
    return str(refused.value)


def test_a_valid_registration_defines_the_eye_frame(registration):
    assert registration.globe.center_mm == (0.0, 0.0)
    assert registration.globe.radius_mm == 12.0
    assert registration.image.mm_per_px == pytest.approx(0.125)
    assert norm(registration.target.at_mm) == pytest.approx(12.0, abs=0.01)
    assert distance_to_polyline(registration.target.at_mm, registration.retina) < 0.01
    assert registration.trocar.at_mm[0] > 0  # 36 degrees to the surgeon's right
    assert set(registration.anatomy) == {"eye_globe", "retina_surface", "retina_target", "trocar"}


def test_the_sha256_depends_on_the_text_alone(registration, registration_toml):
    assert registration.sha256 == parse_camera_registration(registration_toml, "other name").sha256
    assert registration.sha256 != parse_camera_registration(registration_toml + "# note\n", "x").sha256


def test_clips_have_valid_registrations(clip):
    registration = load_camera_registration(clip / "registration.toml")
    assert (registration.width_px, registration.height_px) == (1280, 720)
    assert registration.image.mirrored


@pytest.mark.parametrize(
    ("pattern", "replacement", "expected"),
    [
        (r"^format = 1", "format = 9", "line 2: unknown format 9; this version reads format 1"),
        (r"^width = 320", "width = 0", "image size 0 x 240 px is not positive"),
        (r"^width = 320", 'width = "wide"', "image.width: expected int, got str, found 'wide'"),
        (r"^mirrored = .*", "mirorred = true", "unknown key 'mirorred'; did you mean 'mirrored'?"),
        (r"^mirrored = .*", "", "image: key 'mirrored' is missing"),
        (r"^diameter_mm = .*", "diameter_mm = 2.4", "a globe diameter of 2.4 mm is implausible; use 15 to 35 mm"),
        (r"^radius_px = .*", "radius_px = 20", "a globe radius of 20 px gives an implausible scale"),
        (r"^radius_px = .*", "radius_px = 900", "60 to 200 px is plausible"),
        (r"^center_px = .*", "center_px = [400, 100]", "the globe's centre (400, 100) px is outside"),
        (r"^contour_px = .*", "contour_px = [[160, 216]]", "the contour has 1 points; at least 3 are needed"),
        (r"^contour_px = \[\[.*?\]", "contour_px = [[20, 120]", "contour point 0 lies 5.50 mm outside the globe"),
        (r"^(contour_px = \[\[.*?\], \[.*?\], )", r"\1[160, 216], ", "goes back; points must follow the retina"),
        (r'^\[target\]\npoint_px = .*', "[target]\npoint_px = [160, 160]", "mm off the retina; at most 0.35 mm"),
        (r'^(name = "first"\npoint_px = ).*', r"\1[160, 120]", "trocar 'first' is 12.00 mm inside the globe's inner"),
        (r'^(name = "second"\npoint_px = ).*', r"\1[10, 10]", "trocar 'second' is"),
        (r"^used = true", "used = false", "0 of 2 trocars are marked as used; mark exactly one"),
        (r"^used = false", "used = true", "2 of 2 trocars are marked as used; mark exactly one"),
        (r"^\[globe\]", "[globe", "not valid TOML"),
    ],
)  # fmt: skip
def test_invalid_values_are_refused_in_one_sentence(registration_toml, pattern, replacement, expected):
    message = refuse(changed(registration_toml, pattern, replacement))
    assert expected in message
    assert message.startswith("eye.toml")
    assert "\n" not in message


def test_a_trocar_near_the_target_is_refused(registration_toml):
    target = re.search(r"\[target\]\npoint_px = (.*)", registration_toml)[1]
    text = changed(registration_toml, r'^(name = "first"\npoint_px = ).*', rf"\1{target}")
    assert "5 mm or more is plausible" in refuse(text)


def test_errors_state_the_line(registration_toml):
    text = changed(registration_toml, r"^diameter_mm = .*", "diameter_mm = 2.4")
    line = text.splitlines().index("diameter_mm = 2.4") + 1
    assert refuse(text).startswith(f"eye.toml, line {line}: ")


HOMOGRAPHY = "\n[homography]\nstraight_from_image = [[1.02, 0.0, -3.0], [0.0, 1.0, 0.0], [{}, 0.0, 1.0]]\n"


def test_a_homography_maps_to_the_frontal_image(registration_toml, registration):
    tilted = parse_camera_registration(
        registration_toml + HOMOGRAPHY.format("0.0").replace("1.02, 0.0, -3.0", "1.0, 0.0, 0.0"), "eye.toml"
    )
    assert tilted.target == registration.target
    assert tilted.frontal.image == registration.image
    stretched = parse_camera_registration(registration_toml + HOMOGRAPHY.format("1e-5"), "eye.toml")
    assert stretched.image.to_mm((160.0, 120.0)) == pytest.approx((0.0, 0.0), abs=1e-9)
    # 1.02 / (1 + 0.0016), applied twice where the frontal pixels are closer
    assert abs(stretched.image.to_mm((80.0, 120.0))[0]) == pytest.approx(10 * 1.02, rel=3e-3)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HOMOGRAPHY.format("-0.01"), "the homography maps a part of the image to infinity"),
        (HOMOGRAPHY.format("0.0").replace("1.02", "-1.02"), "0.25 to 4 is plausible"),
        (HOMOGRAPHY.format("0.0").replace("1.02", "9.0"), "scales areas by 9 at the globe's centre"),
        (HOMOGRAPHY.format("0.0").replace("1.02", "nan"), "nan"),
        (HOMOGRAPHY.format("0.0").replace("[1.02, 0.0, -3.0], ", ""), "homography.straight_from_image"),
    ],
)
def test_an_implausible_homography_is_refused(registration_toml, text, expected):
    message = refuse(registration_toml + text)
    assert expected in message
    assert "\n" not in message


def with_background(text: str, width: int = 320, height: int = 240) -> str:
    image = np.full((height, width, 3), 120, np.uint8)
    is_known = np.ones((height, width), bool)
    is_known[:40] = False
    anatomy = replace(
        anatomy_px(parse_camera_registration(text, "eye")),
        background_webp=BackgroundImage(image, is_known).webp,
    )
    return registration_text(anatomy, "Registration.")


def test_the_background_image_is_stored_and_optional(registration_toml):
    text = with_background(registration_toml)
    read = parse_camera_registration(text, "eye.toml")
    assert read.background.is_known.mean() == pytest.approx(200 / 240)
    assert max(len(line) for line in text.split("[empty]")[1].splitlines()) <= 100
    assert registration_text(anatomy_px(read), "Registration.") == text
    assert read.frontal.background is read.background
    without = text[: text.index("[empty]")]
    assert parse_camera_registration(without, "eye.toml").background is None
    assert "empty" not in registration_text(anatomy_px(parse_camera_registration(without, "eye.toml")), "eye")


def test_a_background_image_that_is_invalid_or_of_another_size_is_refused(registration_toml):
    text = with_background(registration_toml)
    line = text[: text.index("webp =")].count("\n") + 1
    for broken in (
        text.replace("UklG", "VklG"),
        text.replace("UklG", "Ukl!"),
        changed(text, "^UklG", "UklGR"),
    ):
        expected = f"eye.toml, line {line}: empty.webp: expected a colour image as WebP in base64"
        assert refuse(broken).startswith(expected)
    expected = "empty.webp: is 160 x 240 px, but the images are 320 x 240 px"
    assert expected in refuse(with_background(registration_toml, width=160))


def test_a_lens_is_kept_and_corrects_pixels(registration):
    width, height = registration.width_px, registration.height_px
    lens = Lens((width, width + 1.0), (width / 2, height / 2), (-0.02, 0.0, 1e-4, 0.0, 0.0), 0.25)
    text = registration_text(replace(anatomy_px(registration), lens=lens), "With a lens.")
    found = parse_camera_registration(text, "eye.toml")
    assert anatomy_px(found).lens == lens
    assert found.image.frontal_from_image == LensMap(lens)
    assert found.frontal.image.frontal_from_image is None
    target_px = anatomy_px(registration).target_px
    assert found.image.to_px(found.target.at_mm) == pytest.approx(target_px, abs=1e-2)
    inside_px = (0.3 * width, 0.6 * height)
    assert norm(subtract(found.image.to_mm(inside_px), registration.image.to_mm(inside_px))) > 0.001
