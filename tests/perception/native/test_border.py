"""No call from Python crashes the process: each wrapper of a C function returns or raises an exception.

`make test-native` runs this while the sanitizers watch every access of C to memory.
"""

import gc
import math
import subprocess
import sys
from contextlib import suppress
from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace

from haptigraph.perception.native import (
    bscan,
    bscan_needle,
    jaws,
    rectification,
    search_grid,
    sharpness,
    strip,
    surface_lines,
    tip_network,
)
from haptigraph.perception.native import pixels as region_pixels
from haptigraph.perception.native.strip import RectifiedStrip

LANES, STATIONS, SIZE_PX = 33, 60, (12, 16)

RECTIFY = """
import numpy as np
from haptigraph.projection import ImageGeometry
from haptigraph.perception.needle.rectify import EyeGeometry, Line, rectify, stations
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
geometry = ImageGeometry(center_px=(160.0, 120.0), mm_per_px=1 / 8, mirrored=True)
eye = EyeGeometry(parse_registration(registration_text(Eye(EyeShape()), geometry, 320, 240), "eye"))
line, image = Line(eye.inwards_rad, 0.0), np.zeros((240, 320), np.uint8)
for _ in range(20):
    try:
        rectify(eye, image, image, line, stations(eye, line))
    except ValueError as error:
        print(error)
"""


def excess(lanes=LANES, stations=STATIONS):
    return np.random.default_rng(1).normal(0, 3, (lanes, stations)).astype(np.float32)


def u_px(stations=STATIONS):
    return np.arange(stations, dtype=np.float32)


def make_strips(count, lanes=LANES, stations=STATIONS):
    return np.stack([excess(lanes, stations)] * count)


def make_strip(**change) -> RectifiedStrip:
    shown = excess()
    shown[14:19, :45] += 60
    known = np.ones(STATIONS, bool)
    planes = np.stack([shown, shown, excess()])
    whole = RectifiedStrip(u_px(), LANES // 2, planes, known, slice(0, 10), slice(14, STATIONS), 2.0)
    return replace(whole, **change) if change else whole


def make_grid_arguments():
    rows, cells = 3, 4
    count = rows * cells
    samples = np.arange(count * search_grid.CELL, dtype=np.int32).reshape(count, search_grid.CELL)
    pixels, sampled = samples.ravel() * 4, np.arange(count, dtype=np.int32)
    flanks = np.zeros((2, rows, cells), np.int32)
    return [
        *(SIZE_PX, pixels, np.ones(len(pixels), bool), sampled, samples, flanks),
        *(np.ones((rows, cells), bool), 2),
    ]


def make_planes():
    shape = SIZE_PX
    return (
        np.ones(shape, bool),
        np.ones((4, 9), bool),
        np.zeros(shape, bool),
        *np.zeros((2, *shape), np.float32),
    )


def learn_background(image, region, chroma_share, is_inside, is_free, *planes):
    region_pixels.LearnedBackground(is_inside, *planes).learn(image, region, chroma_share, is_free)


def images(count):
    return np.random.default_rng(count).integers(0, 256, (count, *SIZE_PX, 3), dtype=np.uint8)


def shaft_patch():
    """A dark shaft in the middle of a patch of its surroundings."""
    grey = np.full((LANES, STATIONS), 90, np.uint8)
    grey[14:19, :45] = 20
    return grey


TIP_WEIGHTS = np.ones(tip_network.WEIGHTS, np.float32)
REGION = slice(2, 6), slice(5, 14)
SPANS = np.array([(0, 9)] * 4, np.int32)
FLAGS = "continues", "is_outside", "uses_chroma"
JAWS = "core_px", "visible_px", "globe", "is_other", "min_length_px", "max_difference_px"
APPEARANCE = (math.nan, math.nan, 0.0, math.nan, math.nan)
POSITIONS = (16, u_px(), (8.0, 6.0), (0.0, 1.0), (1.0, 0.0))

SURFACES = (2, 4, 2, 10, 2, 3, 3, 2.0, 3.0, 45.0, 0.25, 20.0, 60.0, 14.0, 0.4, 2.0, 0.1, 3.0)
RIDGES = (1.0, 90.0, 10.0, 10.0, 0.3, 9.0, 1.5, 4.0, 1, 1, 2, 4, 2, 12, 20, 30)
SHAFTS = (22.0, 0.6, 20.0, 12.0, 8.0, 0.6, 3.0, 4.0, 9.0, 3.0, 0.25, 30.0, 100.0)
BEVELS = (12.0, 3.0, 4.0, 5.0, 3.0, 1.0, (2.0, 9.0), 0.6, 0.8, 1.0, 0.75, 80.0, 30.0, 3)
SURFACE_PAIR = (
    *(np.arange(28) * 2.0, np.full(28, 30.0), np.arange(28) > 9),
    *(np.full(28, 40.0), np.arange(28) > 9),
)


def make_scan(size=(48, 56)):
    """An image with a bright band and a bright line above it, and its cells."""
    image = np.random.default_rng(3).integers(0, 60, size, dtype=np.uint8)
    image[30:44] += 120
    cv2.line(image, (2, 0), (20, 26), 250, 3)
    return image


def make_cells():
    return make_scan().astype(np.int32) * 256


# Each wrapper by the C function it calls, with arguments that are right.
WRAPPERS = {
    "strip_positions": (rectification.strip_positions, lambda: list(POSITIONS)),
    "subtract_background": (
        rectification.subtract_background,
        lambda: [np.ones((LANES, STATIONS, 3), np.uint8), make_strips(3), u_px(), 0.2, (10.0, 50.0), 1.0],
    ),
    "score_lines": (
        lambda *arguments: search_grid.SearchGrid(*arguments[:-3]).score(*arguments[-3:]),
        lambda: [*make_grid_arguments(), np.ones((*SIZE_PX, 3), np.uint8), 0.2, 1.0],
    ),
    "learn_background": (
        learn_background,
        lambda: [np.ones((*SIZE_PX, 3), np.uint8), REGION, 0.2, *make_planes()],
    ),
    "ranked_grey": (
        lambda *given: region_pixels.PixelSample(*given[:2]).ranked_grey(*given[2:]),
        lambda: [SIZE_PX, np.arange(30, dtype=np.int32), np.ones((*SIZE_PX, 3), np.uint8), 20],
    ),
    "mark_stains": (
        region_pixels.mark_stains,
        lambda: [np.ones((*SIZE_PX, 3), np.uint8), REGION, 22, 60, SPANS.copy(), *np.ones((2, 4, 9), bool)],
    ),
    "find_jaws": (
        lambda *given: jaws.find_jaws(*given[:4], **dict(zip(JAWS, given[4:], strict=True))),
        lambda: [
            *(shaft_patch(), np.dstack([shaft_patch()] * 3), np.full((LANES, STATIONS), 90, np.float32), 1.0),
            *(2, 30, ((30.0, 16.0), 40.0), np.zeros((LANES, STATIONS), bool), 3.0, 9.0),
        ],
    ),
    "fill_marked": (
        region_pixels.fill_marked,
        lambda: [*images(1), REGION, np.ones((4, 9), bool), 3, *images(1)],
    ),
    "sum_squares": (bscan.sum_squares, lambda: [make_scan(), 3, 2]),
    "average_cells": (bscan.average_cells, lambda: [make_scan(), 3.3, 1.7]),
    "cell_levels": (lambda *grid: bscan.ScanGrid(*grid).levels(), lambda: [make_cells(), 2]),
    "best_path": (
        bscan.best_path,
        lambda: [make_scan().astype(np.float32), np.array([4, 1, 0, 1, 4], np.float32)],
    ),
    "find_surfaces": (
        lambda *given: bscan.find_surfaces(
            bscan.ScanGrid(*given[:2]),
            bscan.SurfaceSearch(*given[2:-6], bscan.Smoothing(*given[-6:-3]), bscan.Smoothing(*given[-3:])),
        ),
        lambda: [make_cells(), 2, *SURFACES, np.ones(5), 0.2, 1.0, np.ones(7), 0.3, 0.8],
    ),
    "remove_specks": (bscan.remove_specks, lambda: [np.arange(9) % 5 > 1, 3]),
    "surface_lines": (
        lambda *given: surface_lines.surface_lines(
            surface_lines.SurfaceColumns(*given[:4]),
            surface_lines.SurfaceColumns(*given[4:8]),
            surface_lines.LineLimits(*given[8:]),
        ),
        lambda: [
            *(np.arange(28) * 2.0, np.full(28, 30.0), np.ones(28), np.arange(28) % 9 > 3),
            *(np.arange(28) * 2.0, np.full(28, 40.0), np.ones(28), np.arange(28) % 5 > 1),
            *(3.0, 8.0, 18.0, 60.0, 0.2, (28.0, 24.0), 0.01, 0.003, (0.9, 0.6), 6),
        ],
    ),
    "shadow_edge": (
        lambda *given: bscan_needle.shadow_edge(
            given[0], bscan_needle.EdgeSearch(*given[6:]), bscan_needle.SurfacePair(*given[1:6])
        ),
        lambda: [
            make_scan(),
            *SURFACE_PAIR,
            *((2.0, 0.0), (0.57, 0.82), 20.0, 5.0, 12.0, 30.0, 30.0, 3.0, 2.0, 2.0, 9.0, 4.0, 9.0, 0.6, 0.8),
            *(4, 4, 1),
        ],
    ),
    "find_shaft": (
        lambda *given: bscan_needle.find_shaft(
            given[0],
            bscan.ScanGrid(*given[1:3]),
            bscan_needle.RidgeSearch(*given[8:24]),
            bscan_needle.ShaftSearch(*given[24:]),
            bscan_needle.SurfacePair(*given[3:8]),
        ),
        lambda: [make_scan(), make_cells(), 2, *SURFACE_PAIR, *RIDGES, *SHAFTS],
    ),
    "drop_in_vitreous": (
        lambda *given: bscan_needle.drop_in_vitreous(
            given[0], bscan_needle.BevelSearch(*given[4:]), *given[1:4]
        ),
        lambda: [make_scan(), (19.0, 20.0), 30.0, 90.0, *BEVELS],
    ),
    "drop_in_tissue": (
        lambda *given: bscan_needle.drop_in_tissue(
            given[0], bscan_needle.BevelSearch(*given[3:]), *given[1:3]
        ),
        lambda: [make_scan(), (19.0, 31.0), 1.0, *BEVELS],
    ),
    "sharpness": (sharpness.sharpness, lambda: [excess(), 4]),
    "mean_sharpness": (sharpness.mean_sharpness, lambda: [excess()]),
    "sharpness_threshold": (sharpness.sharpness_threshold, lambda: [2.0, 4]),
    "core_contrast": (strip.core_contrast, lambda: [make_strip(), slice(5, 40)]),
    "colored_share": (strip.colored_share, lambda: [make_strip(), slice(25, 40), 1.0]),
    "own_color_share": (
        partial(strip.colored_share, own=True),
        lambda: [make_strip(), slice(25, 40), 1.0],
    ),
    "end_slant": (strip.end_slant, lambda: [make_strip(), (0.5, 0.02), 80.0, 6.0]),
    "estimate_coarse_tip": (strip.estimate_coarse_tip, lambda: [make_strip(), 0.0, -math.inf, 5.0]),
    "tip_window": (tip_network.tip_window, lambda: [make_strip(), 0.5, 0.02, 40.0, 20.0]),
    "judge_tip": (
        tip_network.judge_tip,
        lambda: [make_strip(), TIP_WEIGHTS.copy(), (0.5, 0.02), (40.0, 0.2), 20.0],
    ),
    "fit_line": (strip.fit_line, lambda: [make_strip(), 50.0, 9.0, APPEARANCE]),
    "refine_tip": (
        lambda *arguments: strip.refine_tip(*arguments[:7], **dict(zip(FLAGS, arguments[7:], strict=True))),
        lambda: [make_strip(), 20, 55, 24, 16.2, 0.1, 0.3, True, False, True],
    ),
    "RectifiedStrip": (
        RectifiedStrip,
        lambda: [u_px(), 16, make_strips(2), np.ones(STATIONS, bool), slice(0, 9), slice(12, 60), 2.0],
    ),
}

# What may be None: the numbers of the arguments.
OPTIONAL = {
    "surface_lines": (2, 6),  # standard deviations
    "learn_background": (4, 7),  # what is free, and how much bluer than red the background is
    "find_jaws": (1, 7),  # colours, and another instrument
}


class Liar(np.ndarray):
    """An array that misreports its shape."""

    shape = (LANES, STATIONS)


def misaligned(array):
    padded = np.zeros(array.nbytes + 1, np.uint8)
    return padded[1:].view(array.dtype).reshape(array.shape) if array.ndim else array


def read_only(array):
    array.flags.writeable = False
    return array


VIEWS = (
    lambda array: array[..., ::2],
    lambda array: array[::-1],
    lambda array: array[:0],
    lambda array: array[..., :0],
    lambda array: array[..., 1:],
    lambda array: array[1:],
    lambda array: array.T,
    np.asfortranarray,
    misaligned,
    read_only,
    lambda array: array.astype(array.dtype.newbyteorder()),
    lambda array: array.view(Liar),
    lambda array: np.ma.array(array),
    lambda array: array.astype(np.float64),
    lambda array: array.astype(object),
    lambda array: array.view(np.uint8),
    lambda array: np.frombuffer(b"\xff" * array.nbytes, array.dtype).reshape(array.shape),
    lambda array: np.broadcast_to(array.reshape(-1)[:1], array.shape),
    lambda array: np.broadcast_to(array.reshape(-1)[:1], (2**20, 2**20)),
    lambda array: np.broadcast_to(array.reshape(-1)[:1], (2**33,)),
    lambda array: np.empty((*array.shape[:-1], 2**16), array.dtype),
    lambda array: array.reshape(-1),
    lambda array: array[None],
    lambda array: np.zeros((), array.dtype),
)
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-10, 70),
    st.sampled_from([-(2**31), 2**31 - 1, 2**31, 2**32 + 1, 2**63, 10**400]),
    st.floats(),
    st.sampled_from([np.uint8(140), np.int8(127), np.float32(1e38), np.int64(2**40), np.bool_(True)]),
    st.text(max_size=2),
    st.binary(max_size=9),
    st.slices(70),
    st.builds(slice, st.integers(), st.integers()),
    st.tuples(st.floats(), st.floats()),
    st.lists(st.one_of(st.integers(), st.floats(), st.none()), max_size=6).map(tuple),
)
ANY_ARRAY = st.sampled_from(["f4", "f8", "u1", "?", "i4", ">f4", "c8", "O", "M8[s]", "f4,i4"]).flatmap(
    lambda dtype: st.builds(np.zeros, st.lists(st.integers(0, 40), max_size=3).map(tuple), st.just(dtype))
)


def call_all(shown: RectifiedStrip, number: float, station: int) -> None:
    """Call each function that reads a strip."""
    part = slice(station, station + 12)
    refine, stop = WRAPPERS["refine_tip"][0], min(station + 2, len(shown.u_px))
    for call in (
        lambda: strip.core_contrast(shown, part),
        lambda: strip.end_slant(shown, (number, 0.1), station, abs(number)),
        lambda: strip.end_slant(shown, (0.5, number), 2 * station, 4.0),
        lambda: strip.end_slant(shown, (0.5, 0.0), number, 6.0),
        lambda: strip.colored_share(shown, part, number),
        lambda: strip.colored_share(shown, part, number, own=True),
        lambda: strip.estimate_coarse_tip(shown, number, number, abs(number)),
        lambda: strip.fit_line(shown, number, abs(number), (number, 0.1, station, number, math.nan)),
        lambda: strip.fit_line(shown, math.inf, 16.0, APPEARANCE),
        lambda: tip_network.tip_window(shown, number, 0.1, number, abs(number)),
        lambda: tip_network.tip_window(shown, number, 0.1, station, 20.0, is_outside=True),
        lambda: tip_network.tip_window(shown, 0.5, number, station, 20.0),
        lambda: tip_network.judge_tip(shown, TIP_WEIGHTS, (0.5, number), (station, number), 20.0),
        lambda: refine(shown, 0, stop, station, number, 0.1, 0.3, True, False, True),
        lambda: refine(shown, 0, stop, 2 * station, 16.2, number, number, False, True, True),
        lambda: refine(shown, 0, stop, station, 8.0, 0.0, 0.3, False, False, False),
    ):
        with suppress(ValueError, TypeError, OverflowError):
            call()


def test_a_background_of_another_type_is_refused_and_the_process_survives():
    run = subprocess.run([sys.executable, "-c", RECTIFY], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("background: expected float32, found uint8") == 20


@pytest.mark.parametrize("name", WRAPPERS)
def test_right_arguments_are_accepted(name):
    call, arguments = WRAPPERS[name]
    call(*arguments())


def test_every_wrapper_is_tested():
    modules = (
        *(bscan, bscan_needle, jaws, region_pixels, rectification, search_grid, sharpness, strip),
        *(surface_lines, tip_network),
    )
    values = {name: value for module in modules for name, value in vars(module).items()}
    functions = {name.lstrip("_") for name, value in values.items() if type(value).__name__ == "_FuncPtr"}
    assert functions == set(WRAPPERS) - {"RectifiedStrip"}


@pytest.mark.parametrize("name", WRAPPERS)
@given(data=st.data())
def test_a_wrong_argument_never_crashes(name, data):
    call, make = WRAPPERS[name]
    arguments = make()
    for number in data.draw(st.sets(st.integers(0, len(arguments) - 1), min_size=1, max_size=2)):
        value = arguments[number]
        wrong = st.one_of(SCALARS, ANY_ARRAY)
        if isinstance(value, np.ndarray):
            wrong = st.one_of(wrong, st.sampled_from(VIEWS).map(lambda view, value=value: view(value)))
        arguments[number] = data.draw(wrong)
    with suppress(Exception):
        call(*arguments)


@pytest.mark.parametrize("name", WRAPPERS)
def test_a_wrong_type_is_refused_in_a_sentence(name):
    call, make = WRAPPERS[name]
    for number, value in enumerate(make()):
        for wrong in (None, "x", object()):
            arguments = make()
            arguments[number] = wrong
            if name == "RectifiedStrip" and number == 1:  # half_px, which C does not read
                continue
            if wrong is None and number in OPTIONAL.get(name, ()):
                continue
            with pytest.raises((TypeError, ValueError), match=r"\w+ \w+ \w+") as caught:
                call(*arguments)
            assert type(caught.value) in (TypeError, ValueError), (name, number, wrong, value)


@given(
    st.integers(9, 40).flatmap(
        lambda lanes: st.integers(1, 90).flatmap(
            lambda stations: st.tuples(
                arrays(np.float32, (lanes, stations), elements=st.floats(width=32), fill=st.floats(width=32)),
                arrays(np.float32, stations, elements=st.floats(width=32), fill=st.floats(-99, 99, width=32)),
                st.lists(st.integers(0, stations), min_size=3, max_size=3),
            )
        )
    ),
    st.floats(),
    st.floats(),
    st.integers(0, 90),
)
def test_any_numbers_in_a_strip_are_safe(arrays_and_ends, noise_grey, number, station):
    pixels, along, ends = arrays_and_ends
    known = np.frombuffer(bytes(range(len(along))), np.bool_)
    with suppress(ValueError):  # parts that overlap
        parts = slice(0, ends[0]), slice(*ends[1:])
        call_all(
            RectifiedStrip(along, 16, np.stack([pixels] * 3), known, *parts, noise_grey), number, station
        )
    sharpness.sharpness(pixels, 1 + station % len(along))
    sharpness.mean_sharpness(pixels)


def test_planes_that_do_not_fit_their_strip_are_refused():
    for wrong in (make_strips(1), make_strips(4), excess()):
        with pytest.raises(ValueError, match="planes: expected 2 or 3 planes of rows; found float32"):
            make_strip(planes=wrong)
    image, ends = np.ones((LANES, STATIONS, 3), np.uint8), (0.0, 9.0)
    with pytest.raises(ValueError, match="planes: expected two, for the strip is grey"):
        rectification.subtract_background(image[..., 0].copy(), make_strips(3), u_px(), 0.2, ends, 1.0)
    for part in (np.s_[:, 1:], np.s_[..., 1:], np.s_[::2]):
        with pytest.raises(ValueError, match="expected"):
            rectification.subtract_background(image, make_strips(3)[part], u_px(), 0.2, ends, 1.0)


@given(st.floats(), st.floats(), st.floats(), arrays(np.float32, 20, elements=st.floats(width=32)))
def test_any_position_is_sampled_or_refused(x, angle, light, along):
    with suppress(ValueError, OverflowError):
        direction = math.cos(angle), math.sin(angle)
        whole, part = rectification.strip_positions(5, along, (x, -x), direction[::-1], direction)
        assert np.abs(along).max() <= rectification.MAX_PX
        assert whole.shape == (11, 20, 2) and part.max() < 1024
    background = np.full((2, 11, 20), x, np.float32) if abs(x) < 1e38 else make_strips(2, 11, 20)
    with np.errstate(all="ignore"):
        grey = np.full((11, 20), 255, np.uint8)
        rectification.subtract_background(grey, background, along, 1.0, (x, -x), light)


@pytest.mark.parametrize("field", ["u_px", "planes", "is_known"])
@pytest.mark.parametrize("is_view", [False, True])
def test_a_strip_keeps_the_memory_of_its_arrays(field, is_view):
    owner = np.array(getattr(make_strip(), field))
    shown = make_strip(**{field: owner[...] if is_view else owner})
    expected = strip.fit_line(shown, 50.0, 9.0, APPEARANCE)[0]
    with pytest.raises(ValueError, match="cannot resize"):
        owner.resize((10**6,))
    del owner
    array = getattr(shown, field)
    with pytest.raises(ValueError, match="cannot resize"):
        (array.base if is_view else array).resize((10**6,))
    with suppress(DeprecationWarning):
        array.shape = (1, -1)
    del array
    gc.collect()
    _ = [np.full(STATIONS, 99, np.float32) for _ in range(1000)]
    assert strip.fit_line(shown, 50.0, 9.0, APPEARANCE)[0] == pytest.approx(expected, nan_ok=True)


def test_a_learned_background_keeps_the_memory_of_its_arrays():
    is_inside, _, was_visible, *planes = make_planes()
    views = [np.array(plane)[...] for plane in planes]
    learned = region_pixels.LearnedBackground(is_inside, was_visible, *views)
    for view in views:
        with pytest.raises(ValueError, match="cannot resize"):
            view.base.resize((10**6,))
    learned.learn(np.full((*SIZE_PX, 3), 40, np.uint8), REGION, 0.0, None)
    assert (views[0][REGION] == 40).all()


def test_a_search_grid_does_not_notice_later_changes_of_its_arrays():
    arguments = make_grid_arguments()
    grid = search_grid.SearchGrid(*arguments)
    image = np.random.default_rng(2).integers(0, 255, SIZE_PX, np.uint8)
    before = grid.score(image)
    for array in arguments[1:7]:
        array.view(np.uint8)[...] = 0xFF
    assert np.array_equal(grid.score(image), before)


@pytest.mark.parametrize(
    "region", [(slice(-1, 6), slice(5, 14)), (slice(2, 13), slice(5, 14)), (slice(6, 2), slice(0, 1))]
)
def test_a_region_beyond_the_image_is_refused(region):
    image = np.ones((*SIZE_PX, 3), np.uint8)
    with pytest.raises(ValueError, match="expected one within 12 x 16 px"):
        region_pixels.mark_stains(image, region, 22, 60, SPANS, *np.ones((2, 4, 9), bool))


def test_tissue_is_looked_for_within_the_region_whatever_its_spans_say():
    image = np.full((*SIZE_PX, 3), (200, 50, 50), np.uint8)
    spans = np.array([(-(2**31), 2**31 - 1), (5, 3), (9, 40), (-4, 2)], np.int32)
    dye, blood = np.ones((2, 4, 9), bool)
    region_pixels.mark_stains(image, REGION, 22, 60, spans, dye, blood)
    assert dye.sum(axis=1).tolist() == [9, 0, 0, 2]
    assert not blood.any()


def test_the_background_learns_only_what_is_free_and_takes_what_is_new_as_it_is():
    is_inside, is_free, was_visible, grey, chroma = make_planes()
    is_free[1, 2] = False
    for value, rest in ((40, 40.0), (80, 50.0)):
        image = np.full((*SIZE_PX, 3), value, np.uint8)
        image[..., 2] -= 20
        learn_background(image, REGION, 0.0, is_inside, is_free, was_visible, grey, chroma)
        learned = grey[REGION]
        assert learned[1, 2] == 0
        assert learned[0, 0] == pytest.approx(rest - 20 * 0.299, abs=0.5)
        assert chroma[REGION][0, 0] == 20
    assert not grey[:2].any()
    assert was_visible.sum() == 35


def test_dye_is_bluer_and_blood_is_redder_than_any_other_colour():
    image = np.full((*SIZE_PX, 3), 100, np.uint8)
    image[3, 6], image[4, 7], image[5, 8], image[3, 9] = (
        (123, 100, 90),
        (80, 99, 160),
        (122, 100, 90),
        (9, 9, 99),
    )
    spans = SPANS.copy()
    spans[1, 1] = 4
    dye, blood = np.ones((2, 4, 9), bool)
    dyed, bled = region_pixels.mark_stains(image, REGION, 22, 60, spans, dye, blood)
    assert [tuple(place) for place in np.argwhere(dye)] == [(1, 1)]
    assert [tuple(place) for place in np.argwhere(blood)] == [(2, 2)]
    assert (dyed, bled) == (
        region_pixels.Marked(1, (slice(1, 2), slice(1, 2))),
        region_pixels.Marked(1, (slice(2, 3), slice(2, 3))),
    )


@given(arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))), st.integers(0, 12))
def test_marked_pixels_are_filled_with_the_mean_of_the_others_about_them(is_filled, reach_px):
    (image,) = images(1)
    region = tuple(slice(2, 2 + size) for size in is_filled.shape)
    filled = image.copy()
    region_pixels.fill_marked(image, region, is_filled, reach_px, filled)
    side = (2 * reach_px + 1,) * 2
    free = (~is_filled).astype(np.float32)
    share, light = (cv2.blur(each, side) for each in (free, image[region] * free[..., None]))
    mean = (light / np.maximum(share, np.float32(1e-3))[..., None]).astype(np.uint8)
    expected = image.copy()
    np.copyto(expected[region], mean, where=(is_filled & (share > 0))[..., None])
    np.testing.assert_array_equal(filled, expected)


def test_an_image_is_not_filled_in_place():
    (image,) = images(1)
    with pytest.raises(ValueError, match="filled: expected a writeable image of its own"):
        region_pixels.fill_marked(image, REGION, np.ones((4, 9), bool), 3, image)


@pytest.mark.parametrize("index", [-1, 2**31 - 1, SIZE_PX[0] * SIZE_PX[1]])
@pytest.mark.parametrize("number", [1, 3, 4, 5])
def test_indices_out_of_range_are_refused(index, number):
    arguments = make_grid_arguments()
    arguments[number].reshape(-1)[3] = index
    with pytest.raises(ValueError, match=r"expected indices from 0 to \d+; found"):
        search_grid.SearchGrid(*arguments)


@pytest.mark.parametrize("lanes", [1, 8, 4097])
def test_too_few_or_many_lanes_are_refused(lanes):
    for call in (partial(sharpness.sharpness, group=1), sharpness.mean_sharpness):
        with pytest.raises(ValueError, match=f"excess: expected 9 to 4096 lanes .*; found {lanes} and 4"):
            call(np.zeros((lanes, 4), np.float32))


def test_too_long_a_strip_is_refused():
    with pytest.raises(ValueError, match="at most 16384 stations; found 9 and 16385"):
        sharpness.sharpness(np.zeros((9, 16385), np.float32), 1)


def test_the_longest_and_widest_strips_fit_on_the_stack():
    rng = np.random.default_rng(3)
    for lanes, stations in ((9, 16384), (4096, 60)):
        pixels = rng.normal(0, 9, (lanes, stations)).astype(np.float32)
        image = rng.integers(0, 255, (lanes, stations, 3), np.uint8)
        along = u_px(stations)
        planes = np.stack([pixels] * 3)
        rectification.subtract_background(image, planes.copy(), along, 0.2, (0.0, 1e9), 1.0)
        known, ends = np.ones(stations, bool), (slice(0, stations // 2), slice(stations // 2, stations))
        call_all(RectifiedStrip(along, lanes // 2, planes, known, *ends, 9.0), 2.0 * stations, 20)
