import cv2
import numpy as np
import pytest

from haptigraph.perception.oct.class_maps import Scaling
from haptigraph.perception.oct.class_shadow import Evidence, enters_from_border

SIZE = 256, 256
SCALING = Scaling(1.0, 1.0, 0.015, 0.0066)
ENTRY, TIP = (20.0, 0.0), (120.0, 120.0)


@pytest.mark.parametrize(
    ("entry", "tip", "enters"),
    [
        ((20.0, 0.0), (120.0, 120.0), True),
        ((0.0, 40.0), (100.0, 160.0), True),
        ((255.0, 40.0), (150.0, 160.0), True),
        ((25.0, 6.0), (120.0, 120.0), True),  # metal is first visible a little further in
        ((60.0, 90.0), (120.0, 160.0), False),  # begins inside the image, as a vessel's wall
        ((0.0, 100.0), (200.0, 104.0), False),  # flat, as a layer or a saturated line
        ((0.0, 100.0), (200.0, 60.0), False),  # rises
    ],
)
def test_a_needle_comes_down_from_a_border(entry, tip, enters):
    assert enters_from_border(entry, tip, SIZE, SCALING) == enters


def test_the_distance_to_the_border_is_a_length():
    entry, tip = (60.0, 40.0), (120.0, 110.0)
    assert not enters_from_border(entry, tip, SIZE, SCALING)
    assert enters_from_border(entry, tip, SIZE, Scaling(1.0, 1.0, 0.005, 0.0022))


def scan(*, lit_from=120, dark_grey=30, shadow_grey=30):
    """Tissue as the network sees it, and the image: lit to the right of a column."""
    tissue = np.zeros((256, 256), np.float32)
    tissue[150:200, lit_from:] = 1
    image = np.full((256, 256), dark_grey, np.uint8)
    image[150:200] = shadow_grey
    image[150:200, lit_from:] = 140
    cv2.line(image, (20, 0), (120, 120), 230, 4)
    return image, tissue


def test_a_line_with_a_shadow_that_ends_at_its_tip_is_a_needle():
    assert Evidence(*scan(), SCALING).casts_shadow(ENTRY, TIP)


def test_a_line_with_tissue_below_it_casts_no_shadow():
    image, tissue = scan(lit_from=0)
    assert not Evidence(image, tissue, SCALING).casts_shadow(ENTRY, TIP)


def test_a_network_that_misses_tissue_below_a_line_is_contradicted_by_its_grey():
    """The network calls the columns below the line shadow, but they are as bright as the lit ones."""
    assert not Evidence(*scan(shadow_grey=120), SCALING).casts_shadow(ENTRY, TIP)


def test_a_shadow_that_does_not_end_at_the_tip_is_not_the_needles():
    """A line across a dark margin: the light is lost elsewhere."""
    assert not Evidence(*scan(lit_from=200), SCALING).casts_shadow(ENTRY, TIP)


def test_a_line_in_the_choroid_has_tissue_below_it():
    image, tissue = scan(lit_from=0)
    tissue[150:] = 1
    assert not Evidence(image, tissue, SCALING).casts_shadow((0.0, 205.0), (120.0, 235.0))


def test_without_tissue_there_is_nothing_to_shadow():
    image, tissue = scan()
    assert Evidence(image, np.zeros_like(tissue), SCALING).casts_shadow(ENTRY, TIP)


def test_a_ghost_in_the_shadow_does_not_hide_it():
    image, tissue = scan()
    cv2.line(image, (20, 0), (0, 200), 200, 6)
    assert Evidence(image, tissue, SCALING).casts_shadow(ENTRY, TIP)
