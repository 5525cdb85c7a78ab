import re

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import distance_to_polyline, norm
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import anatomy_px, load_registration, parse_registration
from haptigraph.registration.text import registration_text


def changed(text: str, pattern: str, replacement: str) -> str:
    new, count = re.subn(pattern, replacement, text, count=1, flags=re.MULTILINE)
    assert count == 1
    return new


def refuse(text: str) -> str:
    with pytest.raises(BadInput) as refused:
        parse_registration(text, "eye.toml")
    return str(refused.value)


def test_a_sound_registration_gives_the_eye_frame(registration):
    assert registration.globe.center_mm == (0.0, 0.0)
    assert registration.globe.radius_mm == 12.0
    assert registration.image.mm_per_px == pytest.approx(0.125)
    assert norm(registration.target.at_mm) == pytest.approx(12.0, abs=0.01)
    assert distance_to_polyline(registration.target.at_mm, registration.retina) < 0.01
    assert registration.trocar.at_mm[0] > 0  # 36 degrees to the surgeon's right
    assert set(registration.anatomy) == {"eye_globe", "retina_surface", "retina_target", "trocar"}


def test_the_fingerprint_follows_the_text(registration, registration_toml):
    assert registration.sha256 == parse_registration(registration_toml, "other name").sha256
    assert registration.sha256 != parse_registration(registration_toml + "# note\n", "x").sha256


def test_clips_have_sound_registrations(clip):
    registration = load_registration(clip / "registration.toml")
    assert (registration.width_px, registration.height_px) == (1280, 720)
    assert registration.image.mirrored


@pytest.mark.parametrize(
    ("pattern", "replacement", "told"),
    [
        (r"^format = 1", "format = 9", "line 2: format 9 is not known; this version reads format 1"),
        (r"^width = 320", "width = 0", "image size 0 x 240 px is not a size"),
        (r"^width = 320", 'width = "wide"', "image.width: expected int, got str, found 'wide'"),
        (r"^mirrored = .*", "mirorred = true", "unknown key 'mirorred'; did you mean 'mirrored'?"),
        (r"^mirrored = .*", "", "image: key 'mirrored' is missing"),
        (r"^diameter_mm = .*", "diameter_mm = 2.4", "a globe of 2.4 mm is not an eye; 15 to 35 mm is plausible"),
        (r"^radius_px = .*", "radius_px = 20", "a globe radius of 20 px gives an implausible scale"),
        (r"^radius_px = .*", "radius_px = 900", "60 to 200 px is plausible"),
        (r"^center_px = .*", "center_px = [400, 100]", "the globe's centre (400, 100) px lies outside"),
        (r"^contour_px = .*", "contour_px = [[160, 216]]", "a contour of 1 points; at least 3 are needed"),
        (r"^contour_px = \[\[.*?\]", "contour_px = [[20, 120]", "contour point 0 lies 5.50 mm outside the globe"),
        (r"^(contour_px = \[\[.*?\], \[.*?\], )", r"\1[160, 216], ", "goes back; points must follow the retina"),
        (r'^\[target\]\npoint_px = .*', "[target]\npoint_px = [160, 160]", "mm off the retina; at most 0.35 mm"),
        (r'^(name = "first"\npoint_px = ).*', r"\1[160, 120]", "trocar 'first' lies 12.00 mm inside the globe's inner"),
        (r'^(name = "second"\npoint_px = ).*', r"\1[10, 10]", "trocar 'second' lies"),
        (r"^used = true", "used = false", "0 of 2 trocars are marked used; exactly one must be"),
        (r"^used = false", "used = true", "2 of 2 trocars are marked used; exactly one must be"),
        (r"^\[globe\]", "[globe", "not valid TOML"),
    ],
)  # fmt: skip
def test_nonsense_is_refused_in_one_sentence(registration_toml, pattern, replacement, told):
    message = refuse(changed(registration_toml, pattern, replacement))
    assert told in message
    assert message.startswith("eye.toml")
    assert "\n" not in message


def test_a_trocar_beside_the_target_is_refused(registration_toml):
    target = re.search(r"\[target\]\npoint_px = (.*)", registration_toml)[1]
    text = changed(registration_toml, r'^(name = "first"\npoint_px = ).*', rf"\1{target}")
    assert "5 mm or more is plausible" in refuse(text)


def test_errors_carry_the_line(registration_toml):
    text = changed(registration_toml, r"^diameter_mm = .*", "diameter_mm = 2.4")
    line = text.splitlines().index("diameter_mm = 2.4") + 1
    assert refuse(text).startswith(f"eye.toml, line {line}: ")


SLANT = "\n[homography]\nstraight_from_image = [[1.02, 0.0, -3.0], [0.0, 1.0, 0.0], [{}, 0.0, 1.0]]\n"


def test_a_homography_leads_into_the_straightened_image(registration_toml, registration):
    slanted = parse_registration(
        registration_toml + SLANT.format("0.0").replace("1.02, 0.0, -3.0", "1.0, 0.0, 0.0"), "eye.toml"
    )
    assert slanted.target == registration.target
    assert slanted.frontal.image == registration.image
    stretched = parse_registration(registration_toml + SLANT.format("1e-5"), "eye.toml")
    assert stretched.image.to_mm((160.0, 120.0)) == pytest.approx((0.0, 0.0), abs=1e-9)
    # 1.02 / (1 + 0.0016), and once more where the straightened pixels lie closer
    assert abs(stretched.image.to_mm((80.0, 120.0))[0]) == pytest.approx(10 * 1.02, rel=3e-3)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (SLANT.format("-0.01"), "the homography sends a part of the image to infinity"),
        (SLANT.format("0.0").replace("1.02", "-1.02"), "0.25 to 4 is plausible"),
        (SLANT.format("0.0").replace("1.02", "9.0"), "makes areas 9 times as large"),
        (SLANT.format("0.0").replace("1.02", "nan"), "nan"),
        (SLANT.format("0.0").replace("[1.02, 0.0, -3.0], ", ""), "homography.frontal_from_image"),
    ],
)
def test_a_homography_of_no_camera_is_refused(registration_toml, text, told):
    message = refuse(registration_toml + text)
    assert told in message
    assert "\n" not in message


def with_empty_eye(text: str, width: int = 320, height: int = 240) -> str:
    image = np.full((height, width, 3), 120, np.uint8)
    is_known = np.ones((height, width), bool)
    is_known[:40] = False
    anatomy = replace(
        anatomy_px(parse_registration(text, "eye")), background_webp=BackgroundImage(image, is_known).webp
    )
    return registration_text(anatomy, "Registration.")


def test_the_eye_without_needle_is_kept_and_may_be_left_out(registration_toml):
    text = with_empty_eye(registration_toml)
    read = parse_registration(text, "eye.toml")
    assert read.empty.is_known.mean() == pytest.approx(200 / 240)
    assert max(len(line) for line in text.split("[empty]")[1].splitlines()) <= 100
    assert registration_text(anatomy_px(read), "Registration.") == text
    assert read.frontal.empty is read.empty
    without = text[: text.index("[empty]")]
    assert parse_registration(without, "eye.toml").empty is None
    assert "empty" not in registration_text(anatomy_px(parse_registration(without, "eye.toml")), "eye")


def test_a_picture_that_is_none_or_of_another_size_is_refused(registration_toml):
    text = with_empty_eye(registration_toml)
    line = text[: text.index("webp =")].count("\n") + 1
    for broken in (
        text.replace("UklG", "VklG"),
        text.replace("UklG", "Ukl!"),
        changed(text, "^UklG", "UklGR"),
    ):
        told = f"eye.toml, line {line}: empty.webp: expected a WebP picture in base64"
        assert refuse(broken).startswith(told)
    told = "empty.webp: is 160 x 240 px, but the images are 320 x 240 px"
    assert told in refuse(with_empty_eye(registration_toml, width=160))
