"""How certain a tip is: its standard deviation along the shaft, and whether its place is known at all.

Turns a located tip and what the strip shows about it into a standard deviation. Noise over the slope of the
contrast step is its least part: blur, a point that fades before its end or is lost by compression, and edges
that end before the contrast does leave more open. Where more continues than a shadow could be, or the
standard deviation is too large to tell contact, the place is not known.
"""

import math

from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.strip import core_contrast
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import RectifiedStrip, median

__all__ = ["outside_globe", "with_certainty"]

# The terms of the variance; each a share of a length that the image shows.
BLUR_SHARE = 0.25  # of the blur across the shaft: that along it may differ
EDGELESS_SHARE, EDGELESS_MM = 0.17, 1.0  # of the point without edges, up to a length
FADING_MM = 0.058  # per time that the contrast behind the point is greater than that of the point
MAX_FADING = 2.0  # such times: the point of a bevel is beside the axis, and plain
NOISE_MM = 0.115  # per grey level of noise, of a contrast of one
TEXTURE_GREY = 2.2  # works like noise
FAINT_MM = 0.2  # of a point as faint as texture and compression; less by its contrast squared
LOST_SHARE = 0.3  # of the quantum of a compressed picture: so much is lost of a point
WALL_MM, NEAR_WALL_MM = 0.055, 0.6  # so near to the far wall a point mirrors it: its last part is not seen
BLUNT_SHARE = 0.15  # of the width of a bright end: its rim mirrors what is dark; the mean, and its sd

MAX_SD_MM = 0.2  # of a tip whose place is known
OUTSIDE_MM = 0.03  # sd of a contrast step outside the globe
UNLOCATED_MM = 1.6  # where contrast is lost without a step: the point goes on, too thin or too faint
BEHIND = slice(-9, -1)  # stations about the tip
POINT = slice(-2, 0)  # the same channels as behind it: a point may fade in grey, and not in colour
BEYOND = slice(2, 8)
MAX_SHADOW = 0.4  # contrast of a shadow, as a share of its shaft's


def with_certainty(
    strip: RectifiedStrip,
    tip: TipEstimate,
    until_px: float,
    edges_end_px: float,
    blur_px: float,
    px_per_mm: float,
    rest_px: float = 0.0,
    blunt_px: float = 0.0,
    quantum_grey: float = 0.0,
) -> TipEstimate:
    """Return a tip inside the globe with its standard deviation, and whether its place is known.

    Args:
        strip: The strip along the shaft.
        tip: The selected tip.
        until_px: How far along the strip there is contrast.
        edges_end_px: How far it shows both edges of the shaft.
        blur_px: Standard deviation of the blur across the shaft's edges.
        px_per_mm: Scale.
        rest_px: Length of a faint rest beyond the tip that may belong to the point.
        blunt_px: Width of a bright, blunt end.
        quantum_grey: Least that is left of a wave in a compressed picture.
    """
    behind_grey, point_grey, beyond_grey, noise_grey = _contrasts(strip, tip.u_px)
    faint = (TEXTURE_GREY + LOST_SHARE * quantum_grey) / max(point_grey, 1.0)
    edgeless_px = min(max(tip.u_px - edges_end_px, 0.0), EDGELESS_MM * px_per_mm)
    shift_sd_px = math.hypot(
        BLUR_SHARE * blur_px,
        EDGELESS_SHARE * edgeless_px,
        px_per_mm * FADING_MM * min(max(behind_grey / max(point_grey, 1.0) - 1, 0.0), MAX_FADING),
        px_per_mm * NOISE_MM * (strip.noise_grey + TEXTURE_GREY) / max(tip.contrast_grey, 1.0),
        px_per_mm * FAINT_MM * faint**2,
        px_per_mm * WALL_MM if _is_near_wall(strip, tip.u_px, NEAR_WALL_MM * px_per_mm) else 0.0,
        BLUNT_SHARE * blunt_px,
    )
    continues = until_px > tip.u_px and beyond_grey > max(MAX_SHADOW * behind_grey, noise_grey)
    is_certain = math.hypot(tip.sd_px, shift_sd_px) <= MAX_SD_MM * px_per_mm
    is_known = tip.is_known and is_certain and not continues
    shift_sd_px = math.hypot(tip.shift_sd_px, shift_sd_px, rest_px)
    return replace(tip, hidden_px=BLUNT_SHARE * blunt_px, shift_sd_px=shift_sd_px, is_known=is_known)


def outside_globe(tip: TipEstimate, px_per_mm: float) -> TipEstimate:
    """Return a tip outside the globe with its standard deviation.

    There the background is often unknown, and a sharpened point fades on it. That it is outside is certain.

    Args:
        tip: The selected tip.
        px_per_mm: Scale.
    """
    return replace(tip, shift_sd_px=px_per_mm * (OUTSIDE_MM if tip.contrast_grey else UNLOCATED_MM))


def _is_near_wall(strip: RectifiedStrip, tip_px: float, near_px: float) -> bool:
    """Return whether a tip is near the far wall, if the strip reaches it."""
    stop = strip.inside.stop
    return 0 < stop < len(strip.u_px) and float(strip.u_px[stop]) - tip_px < near_px


def _contrasts(strip: RectifiedStrip, tip_px: float) -> tuple[float, float, float, float]:
    """Return the contrast behind a tip, of its point, and beyond it, and that of noise [grey levels]."""
    tip = int(strip.u_px.searchsorted(tip_px))
    start, stop = max(tip + BEHIND.start, strip.inside.start), min(tip + BEYOND.stop, strip.inside.stop)
    along, noise_grey = core_contrast(strip, slice(start, stop))
    ends = (max(tip + end - start, 0) for end in (BEHIND.stop, POINT.start, POINT.stop, BEYOND.start))
    behind_stop, point_start, point_stop, beyond_start = ends
    parts = along[:behind_stop], along[point_start:point_stop], along[beyond_start:]
    behind_grey, point_grey, beyond_grey = (_median(part) for part in parts)
    return behind_grey, point_grey, beyond_grey, noise_grey


def _median(values: FloatImage) -> float:
    return median(values) if len(values) else 0.0
