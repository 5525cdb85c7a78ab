"""The needle in a B-scan, selected among ridges, and its tip.

Turns ridges and surfaces (px) into one needle. Metal blocks the light: no tissue is visible below the shaft,
from the tip to the image's border on the shaft's side. A ghost casts no shadow, so a ridge with tissue below
it is rejected. The shadow's edge on the tissue shows the column in which the metal ends; the tip is where the
shaft's line meets it, or the lower end of a bright spot beside that line: the far wall of a bevel.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.perception.native.bscan_needle import RidgeLine, ShaftSearch, SurfacePair, find_shaft
from haptigraph.perception.oct.bevel import Drop, drop_in_tissue, drop_in_vitreous
from haptigraph.perception.oct.ridge import Ridge, ridge_search
from haptigraph.perception.oct.scan_image import STEP_MM, ScanImage, scan_image
from haptigraph.perception.oct.shadow import Edge, find_shadow_edge
from haptigraph.perception.oct.surfaces import Surfaces, row_at, without_specks

__all__ = [
    "Needle",
    "NeedleConstants",
    "Shaft",
    "find_needle",
    "without_needle",
]


class NeedleConstants(NamedTuple):
    """Constants of the needle; lengths are counted along the shaft unless they say lateral or axial."""

    min_contrast_grey: float = 22.0
    """Of a ridge against its sides."""
    equal_share: float = 0.6
    """Of the typical contrast: beside a ridge as bright it need not be dark."""
    min_length_mm: float = 0.12
    max_gap_mm: float = 0.06
    max_start_mm: float = 0.3
    """A ghost and its needle meet at the border."""
    min_ridge_share: float = 0.6
    """Of a candidate's length."""
    shadow_margin_mm: float = 0.11
    """Lateral width of the shadow's soft edge."""
    below_shaft_mm: float = 0.046
    """Axial; tissue is visible at least so far below a shaft that casts no shadow."""
    dark_mm: float = 0.15
    """Axial; so far, it is dark below that."""
    max_tissue_share: float = 0.25
    """Of visible tissue in a shadow."""
    on_ridge_mm: float = 0.083
    """Axial; nearer to a ridge, it may have been mistaken for tissue."""
    bevel_mm: float = 0.5
    """From the end of the continuous line: lateral to the tip, axial to tissue with the tip in it."""
    tissue_sd_mm: float = 0.003
    """Lateral; more uncertain is the edge of a shadow that begins in tissue."""
    near_mm: float = 0.06
    """From the shadow's edge to the end of the metal."""
    certain_mm: float = 0.016
    """Lateral; where the edge is less certain, a spot below the line may not be in the tip's column."""
    beyond_tip_mm: float = 0.035
    """The metal's brightness ends so far beyond the tip at most."""
    beyond_spot_mm: float = 0.008
    """The same of a bevel's point that is a spot of its own."""
    spot_mm: float = 0.1
    """From the gap that parts it from the shaft."""
    gap_share: float = 0.67
    """Brightness of that gap, of the spot's."""
    bright_share: float = 0.35
    """Of the typical contrast, for metal before the shadow's edge."""
    agreeing_sds: int = 4
    """Of the shadow's edge, by which the metal's end may move the tip."""
    soft_edge_mm: float = 0.016
    """Lateral; what is bright further beyond the shadow's edge is a floater on the tip."""
    differing_sds: float = 1.25
    """By which the shadow's edges at the surface and below it may differ without a vessel."""
    end_sd_mm: float = 0.03
    """Of the end of a ridge whose shadow falls on no tissue."""


CONSTANTS = NeedleConstants()


class Shaft(NamedTuple):
    """The continuous part of a ridge that casts a shadow."""

    ridge: Ridge
    end_steps: int
    share: float
    """Of its length that is a ridge."""
    typical_grey: float
    """Contrast against its sides."""

    @property
    def end_px(self) -> Vec:
        """Where the continuous part ends."""
        return self.ridge.at_px(self.end_steps)


class Needle(NamedTuple):
    """One needle."""

    ridge: Ridge
    tip_px: Vec
    sd_px: Vec | None
    """Lateral and axial standard deviation of the tip; None if it may be further on, in tissue."""
    confidence: float
    """Share of the continuous line that is a ridge."""


def find_needle(scan: ScanImage, surfaces: Surfaces, dark_grey: float) -> tuple[Needle | None, Surfaces]:
    """Return the needle, None if there is none, and the surfaces without columns mistaken for tissue.

    Args:
        scan: The B-scan.
        surfaces: ILM and RPE.
        dark_grey: Largest grey value beside a needle.
    """
    ridges = ridge_search(scan, dark_grey)
    search = _shaft_search(scan, surfaces.tissue_grey)
    found, ilm_visible, rpe_visible = find_shaft(
        scan.image, scan.grid, ridges, search, SurfacePair(*surfaces[:5])
    )
    without_ridge = surfaces._replace(
        ilm_visible=without_specks(ilm_visible), rpe_visible=without_specks(rpe_visible)
    )
    if found is None:
        return None, without_ridge
    shaft = Shaft(Ridge(found.line, ridges.step_px), found.end_steps, found.share, found.typical_grey)
    needle = _with_tip(scan, shaft, without_ridge)
    half_px = scan.column_px / 2  # half of the column in which the shadow ends shows no tissue
    beyond_px = needle.ridge.side * (surfaces.x_px - needle.tip_px[0])
    in_light, elsewhere = beyond_px > half_px, beyond_px < -half_px
    ilm_visible = surfaces.ilm_visible & in_light | without_ridge.ilm_visible & elsewhere
    rpe_visible = surfaces.rpe_visible & in_light | without_ridge.rpe_visible & elsewhere
    return needle, surfaces._replace(ilm_visible=ilm_visible, rpe_visible=rpe_visible)


def without_needle(scan: ScanImage, needle: Needle) -> ScanImage:
    """Return a B-scan in which it is dark along a needle, or along a ghost that was taken for one."""
    start, tip = ((round(x), round(y)) for x, y in (needle.ridge.line.start_px, needle.tip_px))
    width_px = max(round(CONSTANTS.on_ridge_mm / scan.scale.axial_mm), 1)
    image = cv2.line(scan.image.copy(), start, tip, scan.levels.dark_grey, width_px)
    return scan_image(np.asarray(image, np.uint8), scan.scale)


def _shaft_search(scan: ScanImage, tissue_grey: float) -> ShaftSearch:
    """Return the limits of the search for a shaft."""
    lateral_mm, axial_mm = scan.scale
    return ShaftSearch(
        min_contrast_grey=CONSTANTS.min_contrast_grey,
        equal_share=CONSTANTS.equal_share,
        start_steps=CONSTANTS.max_start_mm / STEP_MM,
        gap_steps=CONSTANTS.max_gap_mm / STEP_MM,
        least_steps=CONSTANTS.min_length_mm / STEP_MM,
        min_ridge_share=CONSTANTS.min_ridge_share,
        on_ridge_rows=CONSTANTS.on_ridge_mm / axial_mm,
        below_shaft_rows=CONSTANTS.below_shaft_mm / axial_mm,
        dark_rows=CONSTANTS.dark_mm / axial_mm,
        margin_px=CONSTANTS.shadow_margin_mm / lateral_mm,
        max_tissue_share=CONSTANTS.max_tissue_share,
        floor_grey=scan.levels.dark_grey,
        tissue_grey=tissue_grey,
    )


def _with_tip(scan: ScanImage, shaft: Shaft, surfaces: Surfaces) -> Needle:
    ridge, end_x = shaft.ridge, shaft.end_px[0]
    edge = find_shadow_edge(scan, ridge, end_x, surfaces)
    if edge is None:
        end = _visible_end(scan, shaft)
        ilm_y = row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_visible, end.tip_px[0])
        may_continue = end.tip_px[1] > ilm_y - CONSTANTS.below_shaft_mm / scan.scale.axial_mm
        return end._replace(sd_px=None) if may_continue else end
    ilm_y, on_line = _crossing(surfaces, ridge, edge)
    shallow = find_shadow_edge(scan, ridge, end_x, surfaces, shallow=True)
    if shallow is not None and _has_metal(shaft, shallow):
        is_above = on_line[1] < ilm_y
        if not is_above:
            surface_y, at = _crossing(surfaces, ridge, shallow)
            is_above = at[1] < surface_y - CONSTANTS.below_shaft_mm / scan.scale.axial_mm
        if is_above:
            edge = _beside_vessels(shaft, edge, shallow)
            ilm_y, on_line = _crossing(surfaces, ridge, edge)
    further_px = ridge.side * (edge.x_px - end_x)
    if on_line[1] < ilm_y and further_px * scan.scale.lateral_mm > CONSTANTS.bevel_mm:
        edge = edge._replace(sd_px=further_px / 2)  # the shadow of something else, or a shaft that fades
    needle = _at_edge(scan, shaft, edge, on_line, ilm_y)
    hidden_mm = (ilm_y - shaft.end_px[1]) * scan.scale.axial_mm
    if on_line[1] >= ilm_y and hidden_mm > CONSTANTS.bevel_mm:
        return needle._replace(sd_px=None)  # metal would be visible above the tissue
    return needle


def _beside_vessels(shaft: Shaft, deep: Edge, shallow: Edge) -> Edge:
    """Return the edge of the needle's shadow, from that at the surface and that below it.

    The shadow of a vessel begins below the surface; there, the needle's may seem to go on, or to end early
    beside tissue that is dimmer than the rest.
    """
    if not _has_metal(shaft, deep):
        return shallow
    apart_px = abs(deep.x_px - shallow.x_px)
    if apart_px > CONSTANTS.differing_sds * math.hypot(deep.sd_px, shallow.sd_px):
        return shallow._replace(sd_px=max(shallow.sd_px, apart_px / 4))
    share = deep.sd_px**2 / (deep.sd_px**2 + shallow.sd_px**2)
    return Edge(deep.x_px + share * (shallow.x_px - deep.x_px), shallow.sd_px * math.sqrt(share))


def _crossing(surfaces: Surfaces, ridge: Ridge, edge: Edge) -> tuple[float, Vec]:
    """Return the row of the ILM in the column of an edge, and where the shaft's line crosses it."""
    ilm_y = row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_visible, edge.x_px)
    return ilm_y, ridge.at_px(ridge.steps_at_column(edge.x_px))


def _at_edge(scan: ScanImage, shaft: Shaft, edge: Edge, on_line: Vec, ilm_y: float) -> Needle:
    """Return a needle whose tip is in the column of the shadow's edge."""
    ridge, (x, y) = shaft.ridge, on_line
    slope = abs(ridge.line.along_px[1] / (ridge.line.along_px[0] or 1e-9))
    if y < ilm_y:
        is_clear = y < ilm_y - CONSTANTS.below_shaft_mm / scan.scale.axial_mm
        in_metal, at, is_spot = _within_metal(scan, shaft, edge) if is_clear else (edge, on_line, False)
        is_earlier = 0 < ridge.side * (x - at[0]) <= CONSTANTS.agreeing_sds * edge.sd_px
        drop = drop_in_vitreous(scan, at if is_earlier else on_line, ilm_y, shaft.typical_grey)
        if is_spot or edge.sd_px * scan.scale.lateral_mm > CONSTANTS.certain_mm:
            drop = Drop(0.0, max(drop.sd_rows, drop.rows / 2))
        if is_earlier or not drop.rows:
            edge, (x, y) = in_metal, at
    else:
        drop = drop_in_tissue(scan, on_line, ridge.side)
        edge = edge._replace(sd_px=math.hypot(edge.sd_px, CONSTANTS.tissue_sd_mm / scan.scale.lateral_mm))
    sd_px = edge.sd_px, math.hypot(edge.sd_px * slope, drop.sd_rows)
    return Needle(ridge, (x, y + drop.rows), sd_px, shaft.share)


def _within_metal(scan: ScanImage, shaft: Shaft, edge: Edge) -> tuple[Edge, Vec, bool]:
    """Return an edge and the tip on the shaft's line, where the metal's brightness allows both.

    Return, too, whether the tip is a spot of its own, so that another one below it is none.

    The tip is not beyond the end of the bright metal, and not much before it. What is bright where
    light passes is a floater. An edge far beyond the metal is that of another shadow.
    """
    ridge, contrast = shaft.ridge, shaft.ridge.line.contrast_grey
    at, column_px = ridge.steps_at_column(edge.x_px), abs(ridge.line.along_px[0]) * ridge.step_px
    end = _last_bright(shaft, at)
    if end < 0:
        return edge, ridge.at_px(at), False
    run = max(end - round(CONSTANTS.near_mm / STEP_MM), 0)
    half_grey = float(contrast[run : end + 1].max()) / 2
    while end + 1 < len(contrast) and contrast[end + 1] > half_grey:
        end += 1
    is_spot = _is_spot(ridge.line, run + int(contrast[run : end + 1].argmax()))
    beyond = (CONSTANTS.beyond_spot_mm if is_spot else CONSTANTS.beyond_tip_mm) / STEP_MM
    inside = min(max(at, end - beyond), end)
    moved_px = abs(inside - at) * column_px
    differs = moved_px > CONSTANTS.agreeing_sds * edge.sd_px
    if differs and at > inside:
        inside = end - beyond / 2
    elif differs and moved_px * scan.scale.lateral_mm > CONSTANTS.soft_edge_mm:
        inside = at
    edge = edge._replace(sd_px=max(edge.sd_px, moved_px / 2))
    return edge, ridge.at_px(inside), is_spot and not differs


def _last_bright(shaft: Shaft, at_steps: float) -> int:
    """Return the last step of metal, up to just beyond the shadow's edge; -1 if there is none.

    Where the metal ends beyond the edge, what is bright behind a gap is a floater.
    """
    at, near = round(at_steps), round(CONSTANTS.near_mm / STEP_MM)
    is_bright = shaft.ridge.line.contrast_grey[: max(at + near + 1, 0)] > (
        CONSTANTS.bright_share * shaft.typical_grey
    )
    if 0 <= at < len(is_bright) and is_bright[at] and (brights := int(is_bright[at:].argmin())):
        return at + brights - 1
    lit = np.flatnonzero(is_bright)
    return int(lit[-1]) if len(lit) else -1


def _is_spot(line: RidgeLine, peak: int) -> bool:
    """Return whether a dark gap parts the brightest place of the metal's end from the shaft."""
    before = slice(max(peak - round(CONSTANTS.spot_mm / STEP_MM), 0), peak + 1)
    contrast_grey, beside_grey = line.contrast_grey[before], line.brighter_grey[before]
    above_grey = contrast_grey + np.maximum(beside_grey - beside_grey[-1], 0)  # a floater is no gap
    return bool(above_grey.min() < CONSTANTS.gap_share * contrast_grey[-1])


def _has_metal(shaft: Shaft, edge: Edge) -> bool:
    at = shaft.ridge.steps_at_column(edge.x_px)
    return _last_bright(shaft, at) >= max(at - CONSTANTS.near_mm / STEP_MM, 0)


def _visible_end(scan: ScanImage, shaft: Shaft) -> Needle:
    """Return a needle whose tip is the end of its ridge, or of the bright spot beyond it."""
    line, end = shaft.ridge.line, shaft.end_steps
    beyond = slice(end, end + round(CONSTANTS.bevel_mm / STEP_MM))
    dark_grey = scan.levels.dark_grey + 2 * CONSTANTS.min_contrast_grey
    spots = np.flatnonzero(
        (line.contrast_grey[beyond] > shaft.typical_grey / 2) & (line.brighter_grey[beyond] < dark_grey)
    )
    last = end + (int(spots[-1]) if len(spots) else 0)
    dx, dy = (abs(part) * CONSTANTS.end_sd_mm / scan.scale.mean_mm for part in line.along_px)
    return Needle(shaft.ridge, shaft.ridge.at_px(last), (max(dx, 1.0), max(dy, 1.0)), shaft.share)
