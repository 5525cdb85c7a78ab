"""`haptigraph register`, from source to files."""

import math
import re
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from helpers import draw_rod, mostly_slow
from registration import errors_px, invalid_pictures, random_view

from haptigraph.analysis.registering.overrides import Overrides
from haptigraph.analysis.registering.registering import all_images, plausible_anatomy, register_source
from haptigraph.cli import main
from haptigraph.errors import BadInput
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

pytestmark = pytest.mark.usefixtures("anatomy_once")


def call(*arguments: object):
    result = CliRunner().invoke(main, ["register", *(str(argument) for argument in arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def refuse(*arguments: object) -> str:
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    *slow, line = result.stderr.strip().splitlines()
    assert all(re.fullmatch(r".+: \d+ of \d+", progress) for progress in slow)  # after 10 s of work
    return line


@pytest.fixture(scope="module")
def picture(quick, tmp_path_factory) -> Path:
    """One image of the simulated eye, needle outside."""
    moment = Phantom(load_scenario(quick)).advance()
    assert moment is not None
    path = tmp_path_factory.mktemp("register") / "eye.png"
    cv2.imwrite(str(path), moment.image)
    return path


@pytest.fixture(scope="module")
def clean_eye(quick) -> np.ndarray:
    """The first image of the simulated eye without a needle inside."""
    phantom = Phantom(load_scenario(quick))
    moments = iter(phantom.advance, None)
    return next(
        moment.image for moment in moments if moment.truth.depth_mm is None or moment.truth.depth_mm < 0
    )


def test_a_source_becomes_a_registration_and_a_picture(quick_uri, tmp_path):
    out = tmp_path / "eye.toml"
    result = call(quick_uri, "-o", out, "--target-mm", "1.885")
    assert result.exit_code == 0, result.output
    found = load_registration(out)
    assert math.dist(found.image.center_px, (240, 148)) < 1.0
    assert 12 / found.image.mm_per_px == pytest.approx(96, abs=1.0)
    assert found.target.at_mm == pytest.approx((1.877, -11.852), abs=0.15)
    assert math.dist(found.trocar.at_mm, (12.85 * math.sin(0.6283), 12.85 * math.cos(0.6283))) < 0.2
    assert re.search(r"residual 0\.\d\d px \(0\.\d+ mm\)", result.stdout)
    assert "mm/px" in result.stdout
    drawn = cv2.imread(str(tmp_path / "eye.png"))
    assert drawn is not None and drawn.shape == (270, 480, 3)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["eye.png", "eye.toml"]


def test_where_a_needle_moves_the_background_is_stored_and_runs_with_it_replay_identically(
    quick_uri, tmp_path, clean_eye
):
    out, record = tmp_path / "eye.toml", tmp_path / "run.mcap"
    assert "reference  image without instrument stored" in call(quick_uri, "-o", out).stdout
    background = load_registration(out).background
    assert np.abs(background.image.astype(int) - clean_eye)[background.is_known].mean() < 3
    assert background.is_known[60:230, 160:320].mean() > 0.97
    run = CliRunner().invoke(
        main, ["run", quick_uri, "--registration", str(out), "--fast", "--record", str(record)]
    )
    assert run.exit_code == 0, run.output
    replayed = CliRunner().invoke(main, ["replay", str(record)])
    assert replayed.exit_code == 0 and "117 of 117" in replayed.output


def test_a_single_image_has_no_background_image(picture, tmp_path):
    out = tmp_path / "eye.toml"
    result = call(picture, "-o", out, "--trocar", "left")
    assert "reference  image without instrument not stored, because no needle moves" in result.stdout
    assert load_registration(out).background is None


def test_a_target_in_pixels_is_moved_onto_the_retina(picture, tmp_path):
    out = tmp_path / "eye.toml"
    assert call(picture, "-o", out, "--trocar", "left", "--target", "255,240").exit_code == 0
    x, y = load_registration(out).image.to_px(load_registration(out).target.at_mm)
    assert math.dist((x, y), (240, 148)) == pytest.approx(96, abs=1.0)
    assert math.atan2(x - 240, y - 148) == pytest.approx(math.atan2(15, 92), abs=0.01)
    far = refuse(picture, "-o", tmp_path / "b.toml", "--trocar", "left", "--target", "240,150")
    assert "mm off the retina; at most 1.5 mm" in far


def test_sides_depend_on_the_mirror(picture, tmp_path):
    for mirror in ("--mirrored", "--not-mirrored"):
        out = tmp_path / f"{mirror}.toml"
        result = call(picture, "-o", out, mirror, "--trocar", "right", "--target-mm", "4")
        assert result.exit_code == 0
        assert "default" not in result.stdout
        found = load_registration(out)
        assert found.trocar.at_mm[0] > 5
        assert found.target.at_mm[0] > 3
        assert found.retina.points_mm[0][0] < 0 < found.retina.points_mm[-1][0]


def test_without_needle_the_user_chooses_the_trocar(picture, tmp_path):
    message = refuse(picture, "-o", tmp_path / "eye.toml")
    assert "no needle moves to show which trocar is in use; give --trocar: " in message
    assert "left at (" in message and "right at (" in message
    given = call(picture, "-o", tmp_path / "eye.toml", "--trocar", "300,65")
    assert given.exit_code == 0, given.output
    assert "px, +0.00 mm along the retina (assumed: its lowest point)" in given.stdout


@pytest.fixture
def two_needles(picture, tmp_path) -> Path:
    """Images of an eye with a turning rod in either trocar."""
    folder, image = tmp_path / "images", cv2.imread(str(picture))
    folder.mkdir()
    for number in range(12):
        drawn = image.copy()
        for side, step, inside_px in ((-1, 2.0, 110), (1, 1.3, 70)):
            angle = math.radians(18 + 12 * math.sin(step * number))
            trocar = 240 + side * 102 * math.sin(math.radians(36)), 148 - 102 * math.cos(math.radians(36))
            draw_rod(drawn, trocar, -side * angle, (-40, inside_px), 4)
        cv2.imwrite(str(folder / f"{number:02d}.png"), drawn)
    return folder


def test_if_two_instruments_move_the_user_chooses_the_trocar(two_needles, tmp_path):
    out = tmp_path / "eye.toml"
    message = refuse(two_needles, "-o", out)
    assert "something moves in more than one trocar (" in message
    assert "and may be the needle; give --trocar: " in message
    assert "left at (" in message and "right at (" in message
    assert not out.exists()
    for side in ("left", "right"):
        result = call(two_needles, "-o", out, "--trocar", side, "--not-mirrored", "--force")
        assert result.exit_code == 0, result.output
        assert result.stdout.count("shaft lines") == 2
        x, _ = load_registration(out).image.to_px(load_registration(out).trocar.at_mm)
        assert (x < 240) == (side == "left")


def test_nothing_is_overwritten_unless_forced(picture, tmp_path):
    for name in ("eye.toml", "eye.png"):
        folder = tmp_path / name.replace(".", "_")
        folder.mkdir()
        (folder / name).write_text("precious")
        out = folder / "eye.toml"
        assert f"{folder / name}: exists already; --force overwrites it" in refuse(picture, "-o", out)
        assert [file.read_text() for file in folder.iterdir()] == ["precious"]
        assert call(picture, "-o", out, "--trocar", "left", "--force").exit_code == 0
        load_registration(out)


def test_a_source_is_never_overwritten_and_the_sentence_says_what_to_type(picture, tmp_path):
    source = tmp_path / "eye.png"
    source.write_bytes(picture.read_bytes())
    sentence = refuse(source, "-o", tmp_path / "eye.toml", "--trocar", "left", "--force")
    other = tmp_path / "eye_registration.png"
    assert sentence == (
        f"haptigraph: {source}: is the source, and would be overwritten by the picture; add --picture {other}"
    )
    assert call(source, "-o", tmp_path / "eye.toml", "--trocar", "left", "--picture", other).exit_code == 0
    assert source.read_bytes() == picture.read_bytes() and other.exists()
    assert f"overwritten by -o; use -o {other}" in refuse(
        source, "-o", source, "--picture", tmp_path / "b.png"
    )


def test_every_stage_reports_its_progress(picture, tmp_path):
    progress = []
    overrides = Overrides(trocar="left")
    register_source(
        str(picture), tmp_path / "eye.toml", overrides, progress=lambda *now: progress.append(now)
    )
    assert progress == [
        ("reading", 0, 25),
        ("reading", 1, 1),
        *(("finding the eye", done, 3) for done in range(4)),
    ]


def test_a_picture_that_may_be_rotated_is_reported_as_not_verified(picture, tmp_path):
    rotated = tmp_path / "rotated.png"
    cv2.imwrite(str(rotated), cv2.rotate(cv2.imread(str(picture)), cv2.ROTATE_90_CLOCKWISE))
    for source, angles in ((picture, "36 deg to the "), (rotated, "54 deg to the right")):
        report = call(source, "-o", tmp_path / "eye.toml", "--trocar", "left", "--force").stdout
        (line,) = (line for line in report.splitlines() if line.startswith("upright"))
        assert "not verified, because no needle moves beside the eye; trocars found" in line
        assert angles in line and "--set source.rotate_deg=90, 180 or 270" in line


def test_no_file_is_written_that_cannot_be_read(picture, tmp_path):
    named = tmp_path / "two\nlines.png"
    named.write_bytes(picture.read_bytes())
    result = call(named, "-o", tmp_path / "eye.toml", "--trocar", "left")
    assert result.exit_code == 2 and "not valid TOML" in result.stderr
    assert list(tmp_path.iterdir()) == [named]


def test_no_file_is_written_if_nothing_is_found(tmp_path):
    wall = tmp_path / "wall.png"
    grain = np.random.default_rng(0).integers(90, 160, (270, 480, 3), np.uint8)
    cv2.imwrite(str(wall), grain)
    out = tmp_path / "out"
    out.mkdir()
    message = refuse(wall, "-o", out / "eye.toml")
    assert message.startswith(f"haptigraph: {wall}: no eye in the picture")
    (tmp_path / "no.png").write_text("no picture")
    assert "not an image" in refuse(tmp_path / "no.png", "-o", out / "eye.toml")
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--target", "here"), "--target 'here' is not a point; use X,Y"),
        (("--target", "1,nan"), "is not a point"),
        (("--trocar", "top"), "--trocar 'top' is not a point; use left, right or X,Y"),
        (("--trocar", "240,150"), "inside the globe's inner wall"),
        (("--trocar", "left", "--target-mm", "30"), "beyond the retina, which extends 15."),
        (("--target", "1,2", "--target-mm", "1"), "exclude each other; give one"),
        (("--diameter-mm", "3"), "implausible for an eye; use 15 to 35"),
        (("--images", "0"), "at least 1"),
    ],
)
def test_invalid_overrides_are_refused_in_one_sentence(picture, tmp_path, options, reason):
    assert reason in refuse(picture, "-o", tmp_path / "eye.toml", *options)
    assert list(tmp_path.iterdir()) == []


def test_a_camera_cannot_be_registered_directly(tmp_path):
    assert "record a short clip" in refuse("camera:0", "-o", tmp_path / "eye.toml")


@pytest.mark.slow  # `make test` finds tilts in tests/perception
def test_a_tilted_camera_has_a_homography(quick, tmp_path):
    scenario = Path(quick).read_text().replace("blur_px", "tilt_deg = [-6, 9]\ndistance_mm = 150\nblur_px")
    scenario = scenario.replace("width_px = 480\nheight_px = 270", "width_px = 960\nheight_px = 540")
    scenario = scenario.replace(
        "center_px = [240.0, 148.0]\npx_per_mm = 8.0", "center_px = [480, 296]\npx_per_mm = 16"
    )
    (tmp_path / "tilted.toml").write_text(scenario)
    out = tmp_path / "eye.toml"
    result = call(f"phantom:{tmp_path / 'tilted.toml'}", "-o", out, "--target-mm", "1.885", "--images", 12)
    assert result.exit_code == 0, result.output
    assert re.search(
        r"tilt       1[01]\.\d deg, the image's left and lower side farther; a homography", result.stdout
    )
    found = load_registration(out)
    truth = parse_registration(Phantom(load_scenario(str(tmp_path / "tilted.toml"))).registration, "truth")
    assert math.dist(found.image.to_px((0.0, 0.0)), truth.image.to_px((0.0, 0.0))) < 1.5
    for point in (*truth.retina.points_mm, truth.target.at_mm, truth.trocar.at_mm):
        assert math.dist(found.image.to_px(point), truth.image.to_px(point)) < 2.0


@pytest.mark.parametrize("number", mostly_slow([1, 4, 8, 13], 1))
def test_random_views_are_registered(number):
    view = random_view(number, 77)
    errors = errors_px(plausible_anatomy(view.images, 2 * view.radius_mm, view.label), view)
    assert errors.center_px < 1.5, view.label
    assert errors.radius_px < 1.5, view.label
    assert errors.retina_px < 2.0, view.label


@pytest.mark.parametrize("number", mostly_slow([0, 1], 0))
def test_images_without_a_valid_eye_are_refused_with_the_reason(number):
    for name, image in islice(invalid_pictures(1, 77), number, None, 2):
        with pytest.raises(BadInput, match=r"no eye|cut off|blurred|too small|only one edge"):
            plausible_anatomy([image], 24.0, name)


def test_a_strong_tilt_is_refused(quick, tmp_path):
    scenario = Path(quick).read_text().replace("blur_px", "tilt_deg = [0, 26]\nblur_px")
    (tmp_path / "tilted.toml").write_text(scenario)
    message = refuse(f"phantom:{tmp_path / 'tilted.toml'}", "-o", tmp_path / "eye.toml", "--images", 4)
    assert "the camera is tilted by 2" in message and "at most 20 deg is supported" in message
    assert not (tmp_path / "eye.toml").exists()


@pytest.mark.slow
def test_labelled_clips_are_registered(clip, tmp_path):
    truth = load_registration(clip / "registration.toml")
    out = tmp_path / "eye.toml"
    assert call(clip / "clip.mp4", "-o", out).exit_code == 0
    found = load_registration(out)
    assert math.dist(found.image.center_px, truth.image.center_px) < 1.5
    assert 12 / found.image.mm_per_px == pytest.approx(12 / truth.image.mm_per_px, abs=1.5)
    off_px = [
        abs(math.dist(found.image.to_px(point), truth.image.center_px) - 12 / truth.image.mm_per_px)
        for point in found.retina.points_mm
    ]
    assert max(off_px) < 2.0
    assert math.dist(found.image.to_px(found.trocar.at_mm), truth.image.to_px(truth.trocar.at_mm)) < 1.5


@pytest.mark.parametrize("uri", ["camera:0", "own_parts:LiveSource"])
def test_what_sets_the_pace_is_recorded_before_it_is_registered(uri):
    with pytest.raises(BadInput, match=f"{uri} cannot be registered directly"):
        next(all_images(uri))
