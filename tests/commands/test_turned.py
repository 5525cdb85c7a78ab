"""A picture that is not upright: refused, turned by settings, and the same settings in the run."""

import json

import cv2
import pytest
from helpers import call, refuse

from haptigraph.recording.reader import RunReader
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import load_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

pytestmark = pytest.mark.usefixtures("anatomy_once")

ROTATE = ("--set", "source.rotate_deg=90")


@pytest.fixture(scope="module")
def clips(quick, tmp_path_factory):
    """Folders of images: `upright`, and `rotated` by 90 degrees counterclockwise."""
    folder = tmp_path_factory.mktemp("clips")
    phantom = Phantom(load_scenario(quick))
    images = [moment.image for moment in iter(phantom.advance, None)][::8]
    for name in ("upright", "rotated"):
        (folder / name).mkdir()
        for number, image in enumerate(images):
            turned = cv2.rotate(image, cv2.ROTATE_90_COUNTERCLOCKWISE) if name == "rotated" else image
            cv2.imwrite(str(folder / name / f"{number:03}.png"), turned)
        more = ROTATE if name == "rotated" else ()
        made = call("register", folder / name, "-o", folder / f"{name}.toml", "--target-mm", "1.9", *more)
        assert made.exit_code == 0, made.output
    return folder


def test_a_rotated_picture_is_refused_with_the_way_out(clips, tmp_path):
    sentence = refuse("register", clips / "rotated", "-o", tmp_path / "eye.toml")
    assert (
        "the eye must be upright, trocars on top, or be turned with --set source.rotate_deg=90, 180 or 270"
        in sentence
    )


def test_a_stated_trocar_does_not_hide_that_the_picture_looks_rotated(clips, tmp_path):
    options = "-o", tmp_path / "eye.toml", "--force", "--trocar"
    doubtful = call("register", clips / "rotated", *options, "148,136").stdout
    assert "upright    DOUBTFUL: what moves beside the eye does not enter from above" in doubtful
    certain = call("register", clips / "upright", *options, "240,45").stdout
    assert "upright    the needle enters from above; trocars found 36 deg to the " in certain


def test_turning_it_back_gives_the_same_registration(clips):
    upright, rotated = (load_registration(clips / f"{name}.toml") for name in ("upright", "rotated"))
    assert (rotated.width_px, rotated.height_px) == (upright.width_px, upright.height_px) == (480, 270)
    assert anatomy_px(rotated).center_px == anatomy_px(upright).center_px
    assert rotated.trocar == upright.trocar
    assert (rotated.turn.rotate_deg, rotated.turn.mirror, upright.turn.rotate_deg) == (90, False, 0)


def test_mirroring_a_source_turns_a_mirrored_image_back(clips, tmp_path):
    flip = ("--set", "source.mirror=true")
    made = call("register", clips / "upright", "-o", tmp_path / "eye.toml", "--target-mm", "1.9", *flip)
    assert made.exit_code == 0, made.output
    flipped, upright = load_registration(tmp_path / "eye.toml"), load_registration(clips / "upright.toml")
    assert upright.image.mirrored and not flipped.image.mirrored
    assert flipped.trocar.at_mm == pytest.approx(upright.trocar.at_mm, abs=0.2)
    assert flipped.target.at_mm == pytest.approx(upright.target.at_mm, abs=0.2)


def test_a_run_with_other_settings_than_the_registration_is_refused(clips):
    sentence = refuse("run", clips / "rotated", "--registration", clips / "rotated.toml", "--fast")
    assert sentence == (
        f"haptigraph: {clips / 'rotated.toml'}: is for images with source.rotate_deg=90 and source.mirror=false, "
        "but the run has source.rotate_deg=0 and source.mirror=false; set both alike, or register again"
    )
    mirror = ("--set", "source.mirror=true")
    assert "source.mirror=true" in refuse(
        "run", clips / "upright", "--registration", clips / "upright.toml", *mirror
    )


def test_a_recording_holds_what_perception_saw(clips, tmp_path):
    record = tmp_path / "run.mcap"
    run = call(
        "run",
        clips / "rotated",
        "--registration",
        clips / "rotated.toml",
        "--fast",
        *ROTATE,
        "--record",
        record,
    )
    assert run.exit_code == 0, run.output
    reader = RunReader(record)
    assert json.loads(reader.info.config)["source"]["rotate_deg"] == 90
    capture, _ = next(iter(reader.records()))
    assert capture.image.shape == (270, 480, 3)
    replayed = call("replay", record)
    assert replayed.exit_code == 0
    again = call("run", record, "--fast")
    assert again.exit_code == 0, again.output
    given = call("run", record, "--fast", "--registration", clips / "rotated.toml")
    assert given.exit_code == 0, given.output
    assert "registration" in refuse("run", record, "--fast", *ROTATE)
    made = call("register", record, "-o", tmp_path / "again.toml", "--target-mm", "1.9")
    assert made.exit_code == 0, made.output
    assert load_registration(tmp_path / "again.toml").turn.rotate_deg == 90  # for the source, as before


def test_other_settings_are_still_for_b_scans(clips, tmp_path):
    assert "only source.rotate_deg and source.mirror are valid" in refuse(
        "register", clips / "upright", "-o", tmp_path / "x.toml", "--set", "source.bits=12"
    )
