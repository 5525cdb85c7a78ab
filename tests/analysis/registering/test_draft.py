"""Drafts of registrations: their initial values, checks, and files."""

import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.analysis.registering.check import Checked, check_draft
from haptigraph.analysis.registering.draft import (
    Draft,
    anatomy_px_of,
    checked_registration,
    draft_from,
    draft_picture,
    open_images,
)
from haptigraph.errors import BadInput
from haptigraph.geometry import distance_to_polyline
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.text import registration_text
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

pytestmark = pytest.mark.usefixtures("anatomy_once")


def first_image(scenario: str):
    moment = Phantom(load_scenario(scenario)).advance()
    assert moment is not None
    return moment.image


@pytest.fixture(scope="module")
def opened(quick):
    return open_images([first_image(quick)], "some\nfolder/eye.png", mirrored=True, diameter_mm=24.0)


@pytest.fixture(scope="module")
def tilted(quick, tmp_path_factory):
    text = Path(quick).read_text().replace("blur_px", "tilt_deg = [-6, 9]\ndistance_mm = 150\nblur_px")
    text = text.replace("width_px = 480\nheight_px = 270", "width_px = 960\nheight_px = 540")
    text = text.replace(
        "center_px = [240.0, 148.0]\npx_per_mm = 8.0", "center_px = [480, 296]\npx_per_mm = 16"
    )
    file = tmp_path_factory.mktemp("tilted") / "tilted.toml"
    file.write_text(text)
    return open_images([first_image(str(file))], "eye.png", mirrored=True, diameter_mm=24.0)


@pytest.fixture(scope="module")
def refused():
    grain = np.random.default_rng(0).integers(90, 160, (270, 480, 3), np.uint8)
    return open_images([grain], "wall.png", mirrored=True, diameter_mm=24.0)


def row(checked, what):
    return next(row for row in checked.rows if row.what.startswith(what))


def shifted(draft, step):
    """The draft with all points moved."""

    def moved(point):
        return point[0] + step[0], point[1] + step[1]

    return replace(
        draft,
        center_px=moved(draft.center_px),
        contour_px=tuple(moved(point) for point in draft.contour_px),
        target_px=moved(draft.target_px),
        trocars=tuple(replace(trocar, point_px=moved(trocar.point_px)) for trocar in draft.trocars),
    )


def test_the_initial_draft_is_what_register_finds(opened):
    assert math.dist(opened.draft.center_px, (240, 148)) < 1.0
    assert opened.draft.radius_px == pytest.approx(96, abs=1.0)
    assert opened.note == "no needle moves to show which trocar is in use; choose it"
    assert {trocar.name for trocar in opened.draft.trocars} == {"left", "right"}
    assert [trocar.used for trocar in opened.draft.trocars] == [True, False]
    checked = check_draft(opened, opened.draft)
    assert checked.problem == ""
    assert row(checked, "Globe").off_px < 0.5
    assert row(checked, "Retina").off_px < 0.5
    target = row(checked, "Target")
    assert (
        target.off_px is None and target.note.startswith("assumed, not measured") and not target.is_plausible
    )
    stated = check_draft(opened, replace(opened.draft, assumed=()))
    assert row(stated, "Target").off_px < 0.01 and row(stated, "Target").is_plausible
    assert "plausible: 0.3 to 4" in row(checked, "Scale").note
    assert "uncertain" in row(checked, "Rim").note or "off by" in row(checked, "Rim").note


def test_residuals_increase_with_the_distance_dragged(opened):
    def at(step):
        return row(check_draft(opened, shifted(opened.draft, step)), "Globe")

    # The error of a circle moved by d is d cos(angle): its RMS is d / sqrt 2.
    assert at((10.0, 0.0)).off_px == pytest.approx(10 / math.sqrt(2), rel=0.05)
    assert at((0.0, 6.0)).off_mm == pytest.approx(6 / math.sqrt(2) * 12 / opened.draft.radius_px, rel=0.1)
    larger = replace(opened.draft, radius_px=opened.draft.radius_px + 5)
    assert row(check_draft(opened, larger), "Globe").off_px == pytest.approx(5, rel=0.05)
    assert row(check_draft(opened, shifted(opened.draft, (4.0, 3.0))), "Trocar").off_px == pytest.approx(5)


def test_an_implausible_scale_is_marked(opened):
    small = replace(opened.draft, radius_px=opened.draft.radius_px / 3)
    scale = row(check_draft(opened, small), "Scale")
    assert not scale.is_plausible
    assert check_draft(opened, small).mm_per_px == pytest.approx(36 / opened.draft.radius_px)


def test_where_register_refuses_there_is_a_default_draft(refused):
    assert refused.anatomy is None
    assert refused.note.startswith("no eye in the picture")
    checked = check_draft(refused, refused.draft)
    assert checked.problem == ""
    assert row(checked, "Globe").note == "no edge was found to compare with"
    registration = checked_registration(refused, refused.draft)
    assert registration.text.startswith("# Registration placed by hand in wall.png.\n")


@given(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), st.floats(0.2, 3))
def test_a_problem_is_reported_exactly_when_a_run_would_refuse(refused, step, factor):
    draft = replace(shifted(refused.draft, step), radius_px=refused.draft.radius_px * factor)
    try:
        problem = check_draft(refused, draft).problem
    except BadInput as error:
        assert "far outside" in str(error)
        return
    try:
        parse_registration(registration_text(anatomy_px_of(refused, draft), "x"), "x")
    except BadInput as error:
        assert problem == error.problem
    else:
        assert problem == ""


def test_the_title_is_one_comment_line_with_the_draft_s_origin(opened):
    title = checked_registration(opened, opened.draft).text.splitlines()[0]
    assert title.startswith(
        "# Registration found by haptigraph in eye.png; globe and retina were uncertain by "
    )
    moved = checked_registration(opened, shifted(opened.draft, (1.0, 0.0))).text.splitlines()[0]
    assert "in eye.png, corrected by hand; " in moved


def test_with_a_tilted_camera_points_are_dragged_in_the_image_as_stored(tilted):
    assert tilted.anatomy.tilt is not None
    checked = check_draft(tilted, tilted.draft)
    assert checked.problem == ""
    assert row(checked, "Globe").off_px < 0.7
    widths = [max(values) - min(values) for values in zip(*checked.outline_px, strict=True)]
    assert abs(widths[0] - widths[1]) > 2  # an ellipse in the image as stored
    assert "deg" in row(checked, "Tilt").note
    target = tilted.draft.target_px[0] + 30.0, tilted.draft.target_px[1] - 12.0
    snapped = check_draft(tilted, replace(tilted.draft, target_px=target)).target_on_retina_px
    assert snapped is not None and math.dist(snapped, target) < 24
    registration = checked_registration(tilted, replace(tilted.draft, target_px=snapped))
    assert registration.image.frontal_from_image is not None
    assert registration.image.to_px(registration.target.at_mm) == pytest.approx(snapped, abs=1e-2)
    assert distance_to_polyline(registration.target.at_mm, registration.retina) < 1e-3
    assert registration.image.to_px((0.0, 0.0)) == pytest.approx(tilted.draft.center_px, abs=1e-2)


@pytest.mark.parametrize("which", ["opened", "tilted", "refused"])
def test_drafts_and_their_checks_can_be_encoded_as_json(which, request):
    opened = request.getfixturevalue(which)
    moved = shifted(opened.draft, (1.5, 0.5))
    encoded = msgspec.json.encode(
        (opened.draft, check_draft(opened, opened.draft), check_draft(opened, moved))
    )
    assert msgspec.json.decode(encoded, type=tuple[Draft, Checked, Checked])[0] == opened.draft


def test_the_background_image_is_saved_with_a_corrected_draft(quick):
    phantom = Phantom(load_scenario(quick))
    images = [moment.image for moment in iter(phantom.advance, None)][::6]
    opened = open_images(images, "clip.mp4", mirrored=True, diameter_mm=24.0)
    saved = checked_registration(opened, shifted(opened.draft, (1.25, 0.5)))
    assert saved.background.webp == checked_registration(opened, opened.draft).background.webp
    assert saved.background.is_known[60:230, 160:320].mean() > 0.95
    single = open_images(images[:1], "image.png", mirrored=True, diameter_mm=24.0)
    assert checked_registration(single, single.draft).background is None


@pytest.mark.parametrize("which", ["opened", "tilted", "refused"])
def test_a_saved_draft_is_read_unchanged(which, request):
    opened = request.getfixturevalue(which)
    written = checked_registration(opened, shifted(opened.draft, (1.25, 0.5)))
    read = draft_from(written, "eye.toml", opened)
    assert read.file == "eye.toml"
    again = checked_registration(opened, read)
    assert again.text.splitlines()[1:] == written.text.splitlines()[1:]
    assert again.text.startswith("# Registration of eye.toml, corrected by hand in ")
    assert check_draft(opened, read).problem == ""


def test_a_file_for_other_images_is_refused(opened, tilted):
    with pytest.raises(BadInput, match="is for images of 960 x 540 px, but this one is 480 x 270 px"):
        draft_from(checked_registration(tilted, tilted.draft), "eye.toml", opened)


@pytest.mark.parametrize("which", ["tilted", "refused"])
def test_the_picture_shows_the_draft_over_the_image(which, request):
    opened = request.getfixturevalue(which)
    drawn = cv2.imdecode(np.frombuffer(draft_picture(opened, opened.draft), np.uint8), cv2.IMREAD_COLOR)
    changed = np.abs(drawn.astype(int) - opened.reference_image).max(axis=2) > 40
    x, y = (round(value) for value in opened.draft.contour_px[len(opened.draft.contour_px) // 4])
    assert changed[y - 1 : y + 2, x - 1 : x + 2].any()
    assert 0.001 < changed.mean() < 0.1


def test_a_target_far_from_the_retina_does_not_snap_to_it(opened):
    off = replace(opened.draft, target_px=opened.draft.center_px)
    checked = check_draft(opened, off)
    assert checked.target_on_retina_px is None
    assert "mm off the retina; at most 0.35 mm is plausible" in checked.problem


def test_a_draft_keeps_how_the_images_were_turned(quick, tmp_path):
    turn = Turn(180, mirror=True)
    image = turn(cv2.rotate(first_image(quick)[:, ::-1], cv2.ROTATE_180))
    found = open_images([image], "eye.png", mirrored=True, diameter_mm=24.0, turn=turn)
    assert not found.draft.mirrored  # the mirror is undone
    registration = checked_registration(found, found.draft)
    assert registration.turn == turn
    assert draft_from(registration, "eye.toml", found).target_px == pytest.approx(
        found.draft.target_px, abs=1e-3
    )
    with pytest.raises(BadInput, match=r"is for images with source\.rotate_deg=180 and source\.mirror=true"):
        draft_from(registration, "eye.toml", replace(found, turn=UPRIGHT))
