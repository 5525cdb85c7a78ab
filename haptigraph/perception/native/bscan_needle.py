"""The needle in a B-scan: ridges, shaft, the edge of its shadow, bevel (`bscan_shafts.c` and others)."""

import ctypes
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import BOOL, BYTE, address, checked
from haptigraph.perception.native.bscan import DOUBLE, MAX_ROWS, MAX_SCAN_PX, ScanGrid
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = [
    "ALONG_STEPS",
    "CORE_STEPS",
    "BevelSearch",
    "EdgeSearch",
    "FoundShaft",
    "RidgeLine",
    "RidgeSearch",
    "ShaftSearch",
    "SurfacePair",
    "drop_in_tissue",
    "drop_in_vitreous",
    "find_shaft",
    "shadow_edge",
]

MAX_RIDGES = LIBRARY.constant("MAX_RIDGES")
ALONG_STEPS, CORE_STEPS = LIBRARY.constant("ALONG_STEPS"), LIBRARY.constant("CORE_STEPS")
"""Averaged along and across a ridge."""

MAX_POSITION_PX = 1e9
_RIDGE_SEARCH = LIBRARY.layout(
    "RidgeSearch",
    ("d", "step_px dark_grey mask_grey strip_grey lowest_slope highest_slope inlier_steps below_ilm_px"),
    *(("d", "across down"), ("i", "side votes erased gap run beyond")),
)
_SURFACE_PAIR = LIBRARY.layout(
    "SurfacePair", ("p", "x_px ilm_px rpe_px ilm_visible rpe_visible"), ("i", "columns")
)
_SHAFT_SEARCH = LIBRARY.layout(
    "ShaftSearch",
    ("d", "min_contrast_grey equal_share start_steps gap_steps least_steps min_ridge_share on_ridge_rows"),
    ("d", "below_shaft_rows dark_rows margin_px max_tissue_share floor_grey tissue_grey"),
)
_SHAFT = LIBRARY.layout(
    "Shaft",
    *(("d", "line.start_px line.along_px line.angle_sd_rad"), ("i", "line.stations")),
    *(("d", "share typical_grey"), ("i", "end_steps number")),
)
_BEVEL_SEARCH = LIBRARY.layout(
    "BevelSearch",
    ("d", "wall_rows spot_rows above_rows below_rows smooth_rows half_px ahead_px"),
    ("d", "bright_share equal_share spot_sd_rows lit_share min_gain floor_grey"),
    ("i", "apart_rows"),
)
_EDGE_SEARCH = LIBRARY.layout(
    "EdgeSearch",
    ("d", "start_px along_px end_x margin_px window_px max_distance_px"),
    ("d", "thick_rows most_rows below_rows below_shaft_rows deep_rows below_rpe_rows"),
    *(("d", "min_contrast_grey halved_grey rise_share"), ("i", "slope_columns run half")),
)

_find_shaft = LIBRARY.function("find_shaft", "piippppippp", ctypes.c_int)
_shadow_edge = LIBRARY.function("shadow_edge", "piippp", ctypes.c_int)
_drop_in_vitreous = LIBRARY.function("drop_in_vitreous", "piipddddp")
_drop_in_tissue = LIBRARY.function("drop_in_tissue", "piipdddp")


class RidgeSearch(NamedTuple):
    """Limits of the search for ridges, as in bscan.h; lengths along and across a ridge in steps."""

    step_px: float
    dark_grey: float
    mask_grey: float
    strip_grey: float
    lowest_slope: float
    highest_slope: float
    inlier_steps: float
    below_ilm_px: float
    across: float
    down: float
    side: int
    votes: int
    erased: int
    gap: int
    run: int
    beyond: int

    def checked(self) -> bytes:
        """Return the limits for C."""
        finite = all(math.isfinite(value) for value in self)
        counts = self.across, self.down, self.side, self.votes
        valid = finite and 0.05 <= self.step_px <= 20 and 0 < self.lowest_slope < self.highest_slope
        if not valid or min(counts) < 1 or min(self[12:]) < 0 or max(*counts, *self[12:]) > MAX_ROWS:
            raise ValueError(f"ridges: expected positive lengths and slopes, found {self}")
        if not (0 <= self.dark_grey <= 1000 and 0 <= self.mask_grey <= 1000):
            raise ValueError(f"ridges: expected grey levels of 0 to 1000, found {self}")
        return pack(_RIDGE_SEARCH, *self)


class EdgeSearch(NamedTuple):
    """A shaft, and limits of the search for the edge of its shadow, as in bscan.h."""

    start_px: tuple[float, float]
    along_px: tuple[float, float]
    end_px: float
    margin_px: float
    window_px: float
    max_distance_px: float
    thick_rows: float
    most_rows: float
    below_rows: float
    below_shaft_rows: float
    deep_rows: float
    below_rpe_rows: float
    min_contrast_grey: float
    halved_grey: float
    rise_share: float
    slope_columns: int
    run: int
    half: int

    def checked(self) -> bytes:
        """Return the limits for C."""
        (x, y), (dx, dy) = self.start_px, self.along_px
        if not all(abs(value) <= MAX_SCAN_PX for value in (x, y, dx, dy, *self[2:])) or not dx:
            raise ValueError(f"edge: expected a slanted shaft and lengths to {MAX_SCAN_PX}, found {self}")
        if min(self.slope_columns, self.run) < 1 or self.half < 0:
            raise ValueError(f"edge: expected positive numbers of columns, found {self}")
        return pack(_EDGE_SEARCH, x, y, dx, dy, *self[2:])


class ShaftSearch(NamedTuple):
    """Limits of the search for a shaft among ridges, as in bscan.h."""

    min_contrast_grey: float
    equal_share: float
    start_steps: float
    gap_steps: float
    least_steps: float
    min_ridge_share: float
    on_ridge_rows: float
    below_shaft_rows: float
    dark_rows: float
    margin_px: float
    max_tissue_share: float
    floor_grey: float
    tissue_grey: float

    def checked(self) -> bytes:
        """Return the limits for C."""
        return pack(_SHAFT_SEARCH, *self)


class BevelSearch(NamedTuple):
    """Limits of the search for the point of a bevel, as in bscan.h."""

    wall_rows: float
    spot_rows: float
    above_rows: float
    below_rows: float
    smooth_rows: float
    half_px: float
    ahead_px: tuple[float, float]
    bright_share: float
    equal_share: float
    spot_sd_rows: float
    lit_share: float
    min_gain: float
    floor_grey: float
    apart_rows: int

    def checked(self) -> bytes:
        """Return the limits for C."""
        if not (1 <= self.apart_rows <= MAX_ROWS and 1 <= self.smooth_rows <= MAX_ROWS):
            raise ValueError(f"bevel: expected 1 to {MAX_ROWS} rows, found {self}")
        near, far = self.ahead_px
        return pack(_BEVEL_SEARCH, *self[:6], near, far, *self[7:])


class SurfacePair(NamedTuple):
    """Both surfaces, by column."""

    x_px: Floats
    """Positions of the columns, ascending, (n,)."""
    ilm_px: Floats
    ilm_visible: Mask
    rpe_px: Floats
    rpe_visible: Mask

    def checked(self) -> bytes:
        """Return the surfaces for C."""
        if not (count := np.size(self.x_px)):
            raise ValueError("surfaces: expected at least one column")
        shape = (count,)
        x, ilm = checked("surface", self.x_px, DOUBLE, shape), checked("surface", self.ilm_px, DOUBLE, shape)
        rpe = checked("surface", self.rpe_px, DOUBLE, shape)
        ilm_visible = checked("surface", self.ilm_visible, BOOL, shape)
        rpe_visible = checked("surface", self.rpe_visible, BOOL, shape)
        return pack(_SURFACE_PAIR, x, ilm, rpe, ilm_visible, rpe_visible, count)


class RidgeLine(NamedTuple):
    """A ridge: a straight line from its entry into the image downwards."""

    start_px: tuple[float, float]
    along_px: tuple[float, float]
    """Direction, length 1."""
    angle_sd_rad: float
    contrast_grey: NDArray[np.float32]
    """Brightness over that of the sides at each step, (n,)."""
    brighter_grey: NDArray[np.float32]
    """Brightness of the brighter side, (n,)."""


class FoundShaft(NamedTuple):
    """The continuous part of a ridge that casts a shadow."""

    line: RidgeLine
    share: float
    """Of its length that is a ridge."""
    typical_grey: float
    """Median contrast."""
    end_steps: int
    """Where it ends."""


def find_shaft(
    image: Image, grid: ScanGrid, ridges: RidgeSearch, search: ShaftSearch, surfaces: SurfacePair
) -> tuple[FoundShaft | None, Mask, Mask]:
    """Return the shaft, and where ILM and RPE are visible beside ridges; None if there is no shaft.

    Args:
        image: (h, w) grey.
        grid: The same, downsampled.
        ridges: Limits of the search for ridges.
        search: Limits of the search for a shaft among them.
        surfaces: Both surfaces.
    """
    width, height, pixels = _checked_image(image)
    # copies, because C changes them
    ilm_visible, rpe_visible = np.array(surfaces.ilm_visible), np.array(surfaces.rpe_visible)
    pair = surfaces._replace(ilm_visible=ilm_visible, rpe_visible=rpe_visible).checked()
    limits = ridges.checked(), search.checked()
    room = math.ceil(math.hypot(width, height) / ridges.step_px) + 1
    profiles = np.empty((2, MAX_RIDGES, room), np.float32)
    shaft = ctypes.create_string_buffer(_SHAFT.size)
    outputs = address(profiles[0]), address(profiles[1])
    found = _find_shaft(pixels, width, height, grid.native, *limits, pair, room, shaft, *outputs)
    if found < 0:
        raise MemoryError
    if not found:
        return None, ilm_visible, rpe_visible
    x, y, dx, dy, angle_sd_rad, stations, share, typical_grey, end_steps, number = _SHAFT.unpack(shaft)
    contrast_grey, brighter_grey = profiles[:, number, :stations]
    line = RidgeLine((x, y), (dx, dy), angle_sd_rad, contrast_grey, brighter_grey)
    return FoundShaft(line, share, typical_grey, end_steps), ilm_visible, rpe_visible


def shadow_edge(image: Image, search: EdgeSearch, surfaces: SurfacePair) -> tuple[float, float] | None:
    """Return the column of the shadow's edge near a shaft's end, and its width; None if there is none.

    Args:
        image: (h, w) grey.
        search: The shaft, and limits.
        surfaces: Both surfaces.
    """
    width, height, pixels = _checked_image(image)
    edge = np.empty(2)
    found = _shadow_edge(pixels, width, height, search.checked(), surfaces.checked(), address(edge))
    if found < 0:
        raise MemoryError
    return (float(edge[0]), float(edge[1])) if found else None


def drop_in_vitreous(
    image: Image, search: BevelSearch, at_px: Vec, ilm_px: float, typical_grey: float
) -> tuple[float, float]:
    """Return how many rows a tip above the retina is below the shaft's line, and the standard deviation.

    Args:
        image: (h, w) grey.
        search: Limits.
        at_px: Where the line crosses the tip's column.
        ilm_px: Row of the ILM there.
        typical_grey: Contrast of the shaft against its sides.
    """
    width, height, pixels = _checked_image(image)
    drop = np.empty(2)
    numbers = *_checked_position(at_px), float(ilm_px), float(typical_grey)
    _drop_in_vitreous(pixels, width, height, search.checked(), *numbers, address(drop))
    return float(drop[0]), float(drop[1])


def drop_in_tissue(image: Image, search: BevelSearch, at_px: Vec, side: float) -> tuple[float, float]:
    """Return the same of a tip in tissue.

    Args:
        image: (h, w) grey.
        search: Limits.
        at_px: Where the line crosses the tip's column.
        side: 1 if the needle comes from the left, else -1.
    """
    width, height, pixels = _checked_image(image)
    drop = np.empty(2)
    numbers = *_checked_position(at_px), math.copysign(1.0, side)
    _drop_in_tissue(pixels, width, height, search.checked(), *numbers, address(drop))
    return float(drop[0]), float(drop[1])


def _checked_image(image: Image) -> tuple[int, int, int]:
    """Return width, height and the address of the pixels of an image, (h, w) grey."""
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    if not 1 <= min(height, width) <= max(height, width) <= MAX_SCAN_PX:
        raise ValueError(f"image: expected 1 to {MAX_SCAN_PX} px, found {width} x {height}")
    return width, height, pixels


def _checked_position(at_px: Vec) -> Vec:
    x, y = at_px
    if not (abs(x) <= MAX_POSITION_PX and abs(y) <= MAX_POSITION_PX):
        raise ValueError(f"position: expected at most {MAX_POSITION_PX:.0f} px, found {at_px}")
    return float(x), float(y)
