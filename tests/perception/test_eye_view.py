import numpy as np

from haptigraph.perception.eye_view import IoctView


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
