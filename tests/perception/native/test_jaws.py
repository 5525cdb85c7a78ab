"""Jaws as a plain implementation with OpenCV finds them, in random patches."""

import cv2
import numpy as np
import pytest

from haptigraph.perception.native.jaws import find_jaws

LANES, STATIONS, CORE_PX, VISIBLE_PX = 41, 120, 2, 50
LEVEL, MIN_CONTRAST_GREY, MAX_CHROMA_GREY, END_STATIONS = 0.45, 12.0, 28, 3
MIN_LENGTH_PX, MAX_DIFFERENCE_PX = 12.0, 14.0
GLOBE = (60.5, 12.25), 66.0
NO_JAWS = np.full((LANES, STATIONS), 100, np.uint8)


def plain_jaws(grey, pixels, background, light, is_other):
    half = LANES // 2
    differs = np.abs(grey.astype(np.float32) - background * np.float32(light))
    means = differs[half - CORE_PX : half + CORE_PX + 1, :VISIBLE_PX].mean(axis=0)
    contrast_grey = float(np.sort(means)[len(means) // 2])
    if contrast_grey < MIN_CONTRAST_GREY:
        return None
    metal = differs >= max(LEVEL * contrast_grey, MIN_CONTRAST_GREY)
    if pixels is not None:
        metal &= np.ptp(pixels, axis=2) < MAX_CHROMA_GREY
    if is_other is not None:
        metal &= ~is_other
    lane, station = np.ogrid[:LANES, :STATIONS]
    (x, y), radius_px = GLOBE
    metal &= (station - x) ** 2 + (lane - y) ** 2 < radius_px**2
    closed = cv2.morphologyEx(metal.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _, parts = cv2.connectedComponents(closed)
    counts = np.bincount(parts[half - 1 : half + 2].ravel(), minlength=2)
    counts[0] = 0
    equal = np.flatnonzero(counts == counts.max())
    part = (parts == min(equal, key=lambda label: int((parts == label).argmax()))) & (parts > 0)
    sides = [slice(half, LANES), slice(0, half + 1)]
    reach = [np.flatnonzero(part[side].any(axis=0)).max(initial=0) for side in sides]
    if max(reach) < MIN_LENGTH_PX:
        return None
    if abs(reach[0] - reach[1]) > MAX_DIFFERENCE_PX:
        sides, reach = [sides[int(np.argmax(reach))]] * 2, [max(reach)] * 2
    tips = []
    for side, last in zip(sides, reach, strict=True):
        lanes = np.nonzero(part[side, max(last - END_STATIONS + 1, 0) : last + 1])[0]
        tips.append((last + 0.5, lanes.mean() + side.start))
    return tuple(tips)


def make_patch(seed: int):
    """A patch with a shaft, two jaws, colour and noise, its background, and another instrument."""
    random = np.random.default_rng(seed)
    background = random.normal(120, 3, (LANES, STATIONS)).astype(np.float32)
    image, half = np.repeat(background[..., None], 3, axis=2), LANES // 2
    metal = tuple(int(random.integers(10, 90)) for _ in range(3)) if seed % 3 else (40, 45, 50)
    cv2.line(image, (0, half), (70, half), metal, 5)
    for side in (-1, 1):
        end = int(random.integers(75, 118)), half + side * int(random.integers(0, 15))
        cv2.line(image, (65, half), end, metal, 3)
    image += random.normal(0, random.uniform(0, 25), image.shape)
    pixels = image.clip(0, 255).astype(np.uint8)
    is_other = np.zeros((LANES, STATIONS), bool)
    is_other[: half - 4, 80:95] = True
    return pixels, background, is_other


def found(grey, pixels, background, light, is_other):
    return find_jaws(
        *(grey, pixels, background, light),
        core_px=CORE_PX,
        visible_px=VISIBLE_PX,
        globe=GLOBE,
        is_other=is_other,
        min_length_px=MIN_LENGTH_PX,
        max_difference_px=MAX_DIFFERENCE_PX,
    )


@pytest.mark.parametrize("light", [1.0, 0.93])
@pytest.mark.parametrize("has_colour", [True, False])
@pytest.mark.parametrize("has_other", [True, False])
def test_they_are_those_of_a_plain_implementation(light, has_colour, has_other):
    number = 0
    for seed in range(60):
        image, background, other = make_patch(seed)
        grey, is_other = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), other if has_other else None
        given = grey, image if has_colour else None, background, light, is_other
        assert found(*given) == plain_jaws(*given), seed
        number += found(*given) is not None
    assert number > 20


def test_without_contrast_or_metal_on_the_line_there_are_none():
    background = NO_JAWS.astype(np.float32)
    assert found(NO_JAWS, None, background, 1.0, None) is None
    aside = NO_JAWS.copy()
    aside[5:9] = 20  # another instrument beside the shaft, whose contrast is that of a faint colour
    aside[18:23, ::2] = 70
    colored = np.dstack([aside] * 3)
    colored[18:23, :, 2] += 60
    assert found(aside, colored, background, 1.0, None) is None


def test_one_long_side_is_both_jaws_closed():
    grey = NO_JAWS.copy()
    grey[18:23, :40] = 20
    grey[22:25, 40:100] = 20
    one, other = found(grey, None, NO_JAWS.astype(np.float32), 1.0, None)
    assert one == other == (99.5, 23.0)
