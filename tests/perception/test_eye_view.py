import numpy as np
import pytest

from haptigraph.geometry import Point, Polyline, Segment, Surface
from haptigraph.perception.eye_view import IoctView, VolumeView, view_of
from haptigraph.registration.loading import parse_registration


def test_the_view_is_square_and_grey_and_black_around_the_eye(registration):
    view = IoctView(registration, size_px=200)
    picture = view(np.full((240, 320, 3), 200, np.uint8))
    assert picture.shape == (200, 200)
    assert picture[100, 100] == 200
    assert picture[0, 0] == 0


def test_positions_appear_where_the_view_maps_them(registration):
    view = IoctView(registration, size_px=300)
    for place_mm in ((0.0, 0.0), (4.0, -6.0), (-7.0, 3.0)):
        image = np.zeros((240, 320), np.uint8)
        x, y = registration.image.to_px(place_mm)
        image[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3] = 255
        picture = view(image)
        rows, columns = np.nonzero(picture > 128)
        shown = view.to_px(registration.image.to_mm((round(x), round(y))))
        assert abs(columns.mean() - shown[0]) < 0.6
        assert abs(rows.mean() - shown[1]) < 0.6


def test_the_view_is_unmirrored(registration):
    assert registration.image.mirrored
    view = IoctView(registration)
    assert view.to_px((5.0, 0.0))[0] > view.to_px((-5.0, 0.0))[0]
    assert view.to_px((0.0, 5.0))[1] < view.to_px((0.0, -5.0))[1]


# --- volumes

VOLUME = """format = 1
[image]
width = 40
height = 60
[scale]
axial_mm_per_px = 0.02
lateral_mm_per_px = 0.02
[volume]
slices = 24
slice_mm = 0.05
[target]
depth_share = 0.5
"""


@pytest.fixture
def volumes():
    return parse_registration(VOLUME, "volumes.toml")


def marked(volumes, point):
    """A dark image with a bright block around a point."""
    _, row = volumes.image.to_px(point.at_mm)
    column = round(point.at_mm[0] / 0.02 + 19.5)
    volume = np.zeros((60, 24, 40), np.uint8)
    number = volumes.image.slices.number(point.z_mm)
    volume[round(row) - 1 : round(row) + 2, number, column - 1 : column + 2] = 255
    return volume.reshape(60, -1)


@pytest.mark.parametrize("point", [Point((0.21, 0.39), 0.275), Point((-0.13, -0.21), -0.375)])
def test_a_volume_is_shown_in_three_sections_through_the_tip_with_the_shapes_where_they_belong(
    volumes, point
):
    view = view_of(volumes, 400)
    assert isinstance(view, VolumeView)
    found = {"needle_tip": point}
    picture, drawn = view(marked(volumes, point), found), view.drawn(found)
    assert len(drawn) == 3
    bright = np.argwhere(picture > 128)
    places = np.array([view.to_px(shapes["needle_tip"].at_mm)[::-1] for shapes in drawn])
    nearest = np.linalg.norm(bright[:, None] - places, axis=2)
    assert set(nearest.argmin(axis=1)) == {0, 1, 2}
    for number in range(3):
        of_this = bright[nearest.argmin(axis=1) == number]
        assert np.abs((of_this.min(axis=0) + of_this.max(axis=0)) / 2 - places[number]).max() < 6


def test_surfaces_are_cut_where_the_tip_is_and_lines_are_projected(volumes):
    grid = (-0.4, 0.0, 0.4)
    surface = Surface(grid, grid, tuple(tuple(0.1 * x + 0.2 * z for x in grid) for z in grid))
    shaft = Segment((-0.3, 0.5), (0.2, 0.1), 0.4, -0.2)
    view = view_of(volumes)
    main, across, above = view.drawn(
        {"needle_tip": Point((0.2, 0.1), -0.2), "ilm": surface, "needle_line": shaft}
    )
    assert np.allclose(main["ilm"].points_mm, [(x, 0.1 * x - 0.04) for x in grid])
    assert np.allclose(across["ilm"].points_mm, [(view.across_mm + z, 0.02 + 0.2 * z) for z in grid])
    assert "ilm" not in above and isinstance(across["ilm"], Polyline)
    assert np.allclose(across["needle_line"].start_mm, (view.across_mm + 0.4, 0.5))
    assert np.allclose(above["needle_line"].end_mm, (0.2, view.above_mm + 0.2))


def test_a_volume_without_a_tip_is_shown_through_its_middle(volumes):
    image = marked(volumes, Point((0.01, 0.01), 0.025))
    assert (view_of(volumes, 300)(image, {}) == 255).any()
