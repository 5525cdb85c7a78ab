import math

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.perception.needle.background import CHROMA_RATE, MAX_CHROMA, MIN_BLUE, Background
from haptigraph.perception.needle.bevel import Bevel
from haptigraph.perception.needle.coarse_tip import TipEstimate, estimate_coarse_tip
from haptigraph.perception.needle.focus import Focus
from haptigraph.perception.needle.rectify import EyeGeometry, Line, stations
from haptigraph.perception.needle.shaft_line import fit_line
from haptigraph.perception.needle.tip_selection import Candidate, Detection, TipSelector
from haptigraph.projection import ImageGeometry
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

GROUND, METAL, END_PX = 150.0, 80.0, 100.0
BGR = np.array([0.114, 0.587, 0.299])  # their shares of the grey
FADES_PX, FAINTEST = 25.0, 0.15  # length of a point's last part; share of its contrast left at the end


def places(eye: EyeGeometry, line: Line) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel is along a line, and across it."""
    y, x = np.mgrid[: eye.height_px, : eye.width_px]
    (x0, y0), (dx, dy) = line.at_px(eye.trocar_px, 0.0), line.direction
    return (x - x0) * dx + (y - y0) * dy, (y - y0) * dx - (x - x0) * dy


def fading_needle(
    eye: EyeGeometry, line: Line, fades_px: float = FADES_PX, end_px: float = END_PX
) -> np.ndarray:
    """A dark needle of 5 px that fades towards its end, on a plain background, in focus."""
    along, across = places(eye, line)
    left = np.clip((end_px - along) / fades_px, 0, 1) * (1 - FAINTEST) + FAINTEST
    covered = np.clip(3.0 - abs(across), 0, 1) * np.clip(end_px + 0.5 - along, 0, 1)
    image = cv2.GaussianBlur(GROUND - METAL * left * covered, (0, 0), 0.7)
    return np.clip(image + np.random.default_rng(1).normal(0, 1.0, image.shape), 0, 255).astype(np.uint8)


def tips_of(
    eye: EyeGeometry, line: Line, image: np.ndarray, expected_px: float, ground: object = round(GROUND)
) -> tuple[TipEstimate, TipEstimate]:
    """The coarse and the sub-pixel tip of a needle on known background."""
    selector, detection = detected(eye, line, image, ground)
    return detection.tip, selector.select(image, detection, expected_px)


def located(eye: EyeGeometry, line: Line, image: np.ndarray) -> TipEstimate:
    """The sub-pixel tip without a shadow that continues it."""
    selector, detection = detected(eye, line, image, round(GROUND))
    tip = selector.select(image, detection)
    return selector.before_shadow(image, detection, tip) or tip


def detected(
    eye: EyeGeometry, line: Line, image: np.ndarray, ground: object
) -> tuple[TipSelector, Detection]:
    background = Background(eye)
    background.learn(np.full(image.shape, ground, np.uint8), None, 20)
    (strip,) = background.rectify(image, line, stations(eye, line))
    coarse = estimate_coarse_tip(strip, eye.px_per_mm, None)
    fit = fit_line(strip, coarse.u_px, strip.half_px)
    detection = Detection(Candidate(line, strip, None, coarse), line, fit, coarse)
    return TipSelector(eye, background, Bevel(), Focus(eye)), detection


@pytest.mark.parametrize("short_px", [0.0, 8.0, 12.0, 16.0])
def test_locates_a_tip_that_was_expected_far_behind(registration, short_px):
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    _, end = tips_of(eye, line, fading_needle(eye, line), END_PX - short_px)
    assert (end.where, end.u_px) == ("inside", pytest.approx(END_PX, abs=1.5))


@pytest.mark.parametrize(
    ("first", "second", "second_half_px", "where_px"),
    [(255.0, 210.0, 1.5, END_PX), (70.0, 128.0, 4.5, END_PX - 40)],
    ids=["a bright needle from its cannula", "a dark needle and its hard shadow"],
)
def test_a_step_where_the_tip_was_is_its_end_unless_something_bright_goes_on(
    registration, first, second, second_half_px, where_px
):
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    along, across = places(eye, line)
    image = np.full(along.shape, GROUND)
    for grey, half_px, end_px in ((second, second_half_px, END_PX), (first, 4.5, END_PX - 40)):
        covered = np.clip(half_px + 0.5 - abs(across), 0, 1) * np.clip(end_px + 0.5 - along, 0, 1)
        image += covered * (grey - image)
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + np.random.default_rng(1).normal(0, 1.0, image.shape)
    coarse, end = tips_of(eye, line, np.clip(image, 0, 255).astype(np.uint8), END_PX - 40)
    assert coarse.u_px == pytest.approx(END_PX, abs=3.0)
    assert end.u_px == pytest.approx(where_px, abs=1.5)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_bead_beyond_the_tip_is_no_part_of_the_needle(registration, side):
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    image = fading_needle(eye, line, fades_px=1.0)
    (x, y), (nx, ny) = line.at_px(eye.trocar_px, END_PX + 17.0), line.normal
    cv2.circle(image, (round(x + 8 * side * nx), round(y + 8 * side * ny)), 8, 10, cv2.FILLED, cv2.LINE_AA)
    coarse, end = tips_of(eye, line, image, END_PX - 1)
    assert coarse.u_px > END_PX + 10  # by contrast alone the bead would be
    assert end.u_px == pytest.approx(END_PX, abs=1.0)


def before_bowl(eye: EyeGeometry, line: Line, ground, grey_left, shadow_px=(0.0, 0.0)) -> np.ndarray:
    """A grey needle on a coloured bowl; `grey_left` is how much brighter it is than the ground, along it.

    In a part of it there is only a shadow.
    """
    along, across = places(eye, line)
    bright = float(ground @ BGR)
    share = min(max(CHROMA_RATE * (MIN_BLUE - ground[0] / bright), 0.0), MAX_CHROMA)
    same = bright + share * (ground[0] - ground[2])  # in the tracker's grey
    covered = np.clip(3.0 - abs(across), 0, 1) * np.clip(END_PX + 0.5 - along, 0, 1)
    is_shadow = ((along >= shadow_px[0]) & (along < shadow_px[1]))[..., None]
    needle = np.where(is_shadow, 0.9 * ground, (same + grey_left(along))[..., None])
    image = ground + covered[..., None] * (needle - ground)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    return np.clip(image + np.random.default_rng(1).normal(0, 1.0, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("ground", "grey_left"),
    [
        ([60.0, 100.0, 150.0], lambda along: 90 * np.clip((END_PX - 20 - along) / 60, 0, 1)),
        ([125.0, 136.0, 143.0], lambda along: np.clip(4 * (END_PX - 40 - along), -8, 40)),
    ],
    ids=["as bright as a brown bowl", "darker than a pale bowl, in a fainter colour"],
)
def test_a_needle_whose_contrast_is_lost_is_followed_by_its_colour(registration, ground, grey_left):
    eye = EyeGeometry(registration)
    line, bowl = Line(eye.inwards_rad, 0.0), np.array(ground)
    _, tip = tips_of(eye, line, before_bowl(eye, line, bowl, grey_left), math.inf, bowl)
    assert tip.where == "inside"
    assert tip.u_px == pytest.approx(END_PX, abs=2.0)


def shown_on_ground(eye: EyeGeometry, line: Line, contrast) -> np.ndarray:
    """An image of a needle, its contrast at positions (along, across) a share of METAL."""
    along, across = places(eye, line)
    image = GROUND - METAL * contrast(along, across)
    image += np.random.default_rng(1).normal(0, 1.0, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("width_px", "left"), [(6.0, 0.7), (9.0, 0.3)], ids=["an even shadow", "a wide shadow"]
)
def test_what_goes_on_softly_is_a_shadow(width_px, left):
    geometry = ImageGeometry(center_px=(320.0, 260.0), mm_per_px=1 / 20, mirrored=True)
    text = registration_text(Eye(EyeShape()), geometry, 640, 520)
    eye = EyeGeometry(parse_registration(text, "an eye from close by"))
    line = Line(eye.inwards_rad + 0.1, 0.0)

    def contrast(along, across):
        shaft = np.clip(3.5 - abs(across), 0, 1) * np.clip(END_PX - 33.5 - along, 0, 1)
        soft = left * np.exp(-((across / width_px) ** 2)) * np.clip(END_PX + 0.5 - along, 0, 1)
        return cv2.GaussianBlur(np.maximum(shaft, soft), (0, 0), 0.7)

    tip = located(eye, line, shown_on_ground(eye, line, contrast))
    assert tip.u_px == pytest.approx(END_PX - 34, abs=5.0)


def test_motion_across_the_shaft_does_not_shorten_it(registration):
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    ends_px = []
    for motion_px in (0.0, 7.0):

        def shown(along, across, half_px=3.5, motion_px=motion_px):
            edges = np.linspace(-motion_px / 2, motion_px / 2, 15)
            covered = np.mean([np.clip(half_px - abs(across - each), 0, 1) for each in edges], axis=0)
            return cv2.GaussianBlur(covered * np.clip(END_PX + 0.5 - along, 0, 1), (0, 0), 0.7)

        ends_px.append(tips_of(eye, line, shown_on_ground(eye, line, shown), math.inf)[1].u_px)
    assert ends_px[1] == pytest.approx(ends_px[0], abs=0.3)


def test_a_soft_shaft_in_a_strip_that_begins_in_the_globe_does_not_end_before_it(registration):
    """Of a deep needle the strip has no part outside, where the shaft could be seen to reach the wall."""
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    image = fading_needle(eye, line)
    background = Background(eye)
    background.learn(np.full(image.shape, round(GROUND), np.uint8), None, 20)
    (strip,) = background.rectify(image, line, stations(eye, line, from_px=30.0))
    assert strip.outside.stop == 0
    coarse = estimate_coarse_tip(strip, eye.px_per_mm, None)
    fit = fit_line(strip, coarse.u_px, strip.half_px)
    soft = replace(fit, is_steep=bytes(len(fit.is_steep)))
    detection = Detection(Candidate(line, strip, None, coarse), line, soft, coarse)
    tip = TipSelector(eye, background, Bevel(), Focus(eye)).select(image, detection)
    assert tip.where == "inside"


@pytest.mark.parametrize(("beyond_px", "is_known"), [(1.5, False), (3.0, False), (10.0, True), (30.0, True)])
def test_a_tip_that_has_just_come_through_the_wall_is_not_known_at_once(registration, beyond_px, is_known):
    eye = EyeGeometry(registration)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    end_px = eye.wall_px(line)[1] + beyond_px
    image = fading_needle(eye, line, fades_px=0.1, end_px=end_px)
    selector, detection = detected(eye, line, image, round(GROUND))
    selected = replace(detection, tip=selector.select(image, detection))
    for known in (is_known, True):
        tip = selector.with_certainty(selected)
        assert tip.where == "inside"
        assert tip.u_px == pytest.approx(end_px, abs=1.5)
        assert tip.is_known == known
