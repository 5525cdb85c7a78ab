"""Rectified strips as Python and C share them, and each function of the library that reads one."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import force_setattr

from haptigraph.imaging import FloatImage, Mask
from haptigraph.perception.native.arrays import (
    BOOL,
    FLOAT,
    address,
    checked,
    checked_planes,
    checked_scale,
    owners_of,
)
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = [
    "BEHIND_PX",
    "BLOCK",
    "STATION_PX",
    "RectifiedStrip",
    "colored_share",
    "core_contrast",
    "end_slant",
    "estimate_coarse_tip",
    "fit_line",
    "native_of",
    "refine_tip",
]

STATION_PX = float(LIBRARY.constant("STATION_PX"))
"""Between the stations of a strip; 1 in a tip patch."""

BLOCK = LIBRARY.constant("BLOCK")
"""Stations that are averaged before edges are detected."""

BEHIND_PX = LIBRARY.constant("BEHIND_PX")
"""Of a needle in a tip patch."""

_STRIP = LIBRARY.layout(
    "Strip",
    *(("p", "excess.first"), ("i", "excess.stride excess.lanes excess.stations")),
    *(("p", "detrended.first"), ("i", "detrended.stride detrended.lanes detrended.stations")),
    *(("p", "u_px is_known"), ("d", "noise_grey"), ("i", "outside_stop inside_start inside_stop")),
    *(("p", "chroma.first"), ("i", "chroma.stride chroma.lanes chroma.stations")),
)
_APPEARANCE = LIBRARY.layout("Appearance", ("d", "highlight highlight_sd images shaded_px"))
_LINE_FIT = LIBRARY.layout(
    "LineFit",
    *(
        ("d", "offset_px slope covariance light_rad width_px blur_px scatter appearance"),
        ("p", "is_on_line is_steep"),
    ),
    *(("i", "blocks on_line"), ("d", "max_offset_px")),
)

_TIP_PATCH = LIBRARY.layout(
    "TipPatch",
    *(("d", "middle_px blur_px fading_share"), ("i", "start stop continues about")),
    ("i", "is_outside uses_chroma"),
)

_core_contrast = LIBRARY.function("core_contrast", "piip", ctypes.c_double)
_colored_share = LIBRARY.function("colored_share", "piid", ctypes.c_double)
_own_color_share = LIBRARY.function("own_color_share", "piid", ctypes.c_double)
_end_slant = LIBRARY.function("end_slant", "pddddp", ctypes.c_int)
_estimate_coarse_tip = LIBRARY.function("estimate_coarse_tip", "pdddp", ctypes.c_int)
_fit_line = LIBRARY.function("fit_line", "pddppppp", ctypes.c_int)
_refine_tip = LIBRARY.function("refine_tip", "ppp", ctypes.c_int)

_Pair, _Triple = (ctypes.c_double * count for count in (2, 3))
_LineFitBuffer = ctypes.c_char * _LINE_FIT.size


class _Native(Struct, frozen=True):
    """A strip as C has it."""

    packed: bytes
    lanes: int
    stations: int
    owners: tuple[Any, ...]
    """What owns its memory."""


class RectifiedStrip(Struct, frozen=True, eq=False):
    """Rectified pixels along an expected line."""

    u_px: FloatImage
    """Position of each station along the line, evenly spaced, (n,)."""
    half_px: int
    """Lanes to either side of the line."""
    planes: FloatImage
    """`excess`, `detrended` and, unless the grey alone counts, how much bluer than red the pixels are, over
    background and ramp, (2 or 3, 2 half_px + 1, n)."""
    is_known: Mask
    """Stations whose background is known, (n,)."""
    outside: slice
    """Stations outside the wall, from the first on."""
    inside: slice
    """Stations within the globe; those in the wall are in neither."""
    noise_grey: float
    """Standard deviation of a pixel of `excess` without needle."""
    native: Any = None
    """The same for C; always made anew from the rest."""

    @property
    def excess(self) -> FloatImage:
        """Grey levels over the background and over the ramp between the flanks, (2 half_px + 1, n)."""
        plane: FloatImage = self.planes[0]
        return plane

    @property
    def detrended(self) -> FloatImage:
        """Grey levels over the ramp between the flanks alone, same shape."""
        plane: FloatImage = self.planes[1]
        return plane

    @property
    def wall_px(self) -> float:
        """Position of the last station outside the wall; there must be one."""
        return float(self.u_px[self.outside.stop - 1])

    @property
    def inner_px(self) -> float:
        """Position of the first station within the globe; there must be one."""
        return float(self.u_px[self.inside.start])

    def __post_init__(self) -> None:
        planes, u_px, is_known = self.planes, self.u_px, self.is_known
        apart, first, *rest = checked_planes("planes", planes)
        stations = rest[2]
        if not stations:
            raise ValueError("planes: expected at least one station")
        if not type(self.outside) is type(self.inside) is slice:
            raise TypeError("outside, inside: expected two slices")
        ends = self.outside.stop, self.inside.start, self.inside.stop
        if not (0 <= ends[0] <= ends[1] <= stations and 0 <= ends[2] <= stations):
            raise ValueError(f"outside, inside: expected two parts of {stations} stations, found {ends}")
        along = checked("u_px", u_px, FLOAT, (stations,)), checked("is_known", is_known, BOOL, (stations,))
        chroma = (first + 2 * apart, *rest) if len(planes) > 2 else (0, 0, 0, 0)
        packed = pack(_STRIP, first, *rest, first + apart, *rest, *along, self.noise_grey, *ends, *chroma)
        force_setattr(self, "native", _Native(packed, rest[1], stations, owners_of(planes, u_px, is_known)))


def core_contrast(strip: RectifiedStrip, part: slice) -> tuple[FloatImage, float]:
    """Return the contrast of the middle lanes, (n,) grey levels, and the contrast that noise does not reach.

    They must differ from the flanks and from the background: a stain that was always there is no needle, nor
    is a place that a needle has left. The root mean square counts, for a needle may be darker on one side and
    brighter on the other, and only its rims may show.

    Args:
        strip: The strip.
        part: Of its stations.
    """
    native = native_of(strip)
    start, stop = _span(part, native.stations)
    contrast = np.empty(max(stop - start, 0), np.float32)
    return contrast, _core_contrast(native.packed, start, stop, address(contrast))


def colored_share(strip: RectifiedStrip, part: slice, min_grey: float, *, own: bool = False) -> float:
    """Return the share of some stations whose middle has a colour that no shadow explains.

    Args:
        strip: The strip.
        part: Of its stations.
        min_grey: The colour right before them must be at least as clear, else 0 is returned.
        own: Whether it must be the same colour, half as clear at least.
    """
    native, share_of = native_of(strip), _own_color_share if own else _colored_share
    return float(share_of(native.packed, *_span(part, native.stations), float(min_grey)))


def end_slant(
    strip: RectifiedStrip, line: tuple[float, float], tip_px: float, width_px: float
) -> tuple[float, float, float] | None:
    """Return how a shaft's end is cut: slant, curve and the slant's sd [widths]; None if too little shows.

    Args:
        strip: The strip.
        line: Offset and slope of the shaft's middle.
        tip_px: The tip along the strip.
        width_px: Of the shaft.
    """
    found, given = _Triple(), map(float, (*line, tip_px, width_px))
    return (found[0], found[1], found[2]) if _end_slant(native_of(strip).packed, *given, found) else None


def estimate_coarse_tip(
    strip: RectifiedStrip, usual_grey: float, tracked_px: float, px_per_mm: float
) -> tuple[int, int, float]:
    """Return where a tip is, its station, and the evidence for it [px] (`coarse_tip.c`).

    Args:
        strip: The strip; the shaft is near its middle.
        usual_grey: Contrast that this needle had inside before; 0 if unknown.
        tracked_px: Its expected tip.
        px_per_mm: Scale.

    Returns:
        0 for no needle, 1 for a tip outside the wall, 2 occluded by it, 3 inside; the station and evidence.
    """
    packed, tip, scale = native_of(strip).packed, _Pair(), checked_scale(px_per_mm)
    where = _estimate_coarse_tip(packed, float(usual_grey), float(tracked_px), scale, tip)
    return where, int(tip[0]), tip[1]


def fit_line(
    strip: RectifiedStrip, tip_px: float, miss_px: float, appearance: Sequence[float]
) -> tuple[tuple[Any, ...], FloatImage, Mask, bytes] | None:
    """Fit the shaft's middle line to all that is visible of it before the tip (`shaft_line.c`).

    Args:
        strip: The strip.
        tip_px: Approximate tip.
        miss_px: How far the shaft may be from the strip's middle.
        appearance: The fields of `Appearance` in native.h, (5,).

    Returns:
        The numbers of `LineFit` in native.h, without its addresses; the blocks' positions, whether they are
        on the line, and whether their edges are steep, (n,) each. None if too few blocks show two edges on
        one line.

    Raises:
        MemoryError: If memory runs out.
    """
    native, fit = native_of(strip), _LineFitBuffer()
    room = native.stations // BLOCK + 1
    u_px, masks = np.empty(room, np.float32), np.empty((2, room), np.bool_)
    is_on_line = address(masks)
    status = _fit_line(
        *(native.packed, float(tip_px), float(miss_px), pack(_APPEARANCE, *appearance)),
        *(fit, address(u_px), is_on_line, is_on_line + room),
    )
    if status < 0:
        raise MemoryError("no memory to fit a line to the shaft")
    if not status:
        return None
    *numbers, _, _, blocks, on_line, max_offset_px = _LINE_FIT.unpack(fit)
    numbers += blocks, on_line, max_offset_px
    return tuple(numbers), u_px[:blocks], masks[0, :blocks], masks[1, :blocks].tobytes()


def refine_tip(
    strip: RectifiedStrip,
    start: int,
    stop: int,
    about: int,
    middle_px: float,
    blur_px: float,
    share: float,
    *,
    continues: bool,
    is_outside: bool,
    uses_chroma: bool,
) -> tuple[float, float, float] | None:
    """Locate a tip sub-pixel (`subpixel_tip.c`; the arguments are the fields of its `TipPatch`).

    Returns:
        The tip from the patch's first station on [px], its standard deviation [px] and the needle's contrast
        [grey levels], or None if the contrast does not fall there.
    """
    native, tip = native_of(strip), _Triple()
    patch = pack(
        *(_TIP_PATCH, middle_px, blur_px, share, start, stop, continues, about),
        *(is_outside, uses_chroma),
    )
    if not 0 <= start <= stop <= native.stations:
        raise ValueError(f"patch: expected a part of {native.stations} stations, found {start} to {stop}")
    is_found = _refine_tip(native.packed, patch, tip)
    return (tip[0], tip[1], tip[2]) if is_found else None


def native_of(strip: RectifiedStrip) -> _Native:
    """Return a strip as C has it."""
    if type(strip) is not RectifiedStrip or type(strip.native) is not _Native:
        raise TypeError(f"strip: expected a RectifiedStrip, found {type(strip).__name__}")
    return strip.native


def _span(part: slice, stations: int) -> tuple[int, int]:
    """Return the first station of a part, and the one after its last."""
    if type(part) is not slice:
        raise TypeError(f"part: expected a slice, found {type(part).__name__}")
    start, stop, _ = part.indices(stations)
    return start, stop
