"""Find the section in depth images: a plane through the eye's cut face, moved behind it to the section."""

import math
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np

from haptigraph.assemble import SOURCES, open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.errors import BadInput
from haptigraph.imaging import Floats
from haptigraph.messages import DepthImage
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.projection import DepthCamera
from haptigraph.registration.depth import MAX_SCALE, DepthPlane
from haptigraph.registration.text import AnatomyPx
from haptigraph.sources.naming import split_source
from haptigraph.sources.reading import read_images
from haptigraph.stages import Source

__all__ = ["depth_line", "plane_of_face", "section_in_depth"]

MAX_IMAGES = 40
MIN_SEEN_SHARE = 0.3  # of the images in which a pixel must have a depth
WALL_RATIO = 1.12  # of the outer radius to the inner, where the outer edge was not found
EDGE_SHARE = 0.2  # of the face's width, left out at either edge: depths there are wrong
RINGS, RAYS = 7, 720
OUTLIER_SD, NEAR_SD, ROUNDS = 3.0, 60.0, 8  # at first, a tilted face may be that far from its median
MIN_INLIER_SHARE = 0.4
ALIKE_PX = 5.0  # across the matching window of a stereo camera: within it, errors are one
FLATNESS_MM = 0.1  # standard deviation of a cut or printed face over its radius
WARNING_SHARE = 0.05  # between the scales of depth and globe


def section_in_depth(source: str, anatomy: Anatomy, found: AnatomyPx) -> DepthPlane | None:
    """Return where the section is in a source's depth images; None if it has none.

    Args:
        source: Anything that can be registered.
        anatomy: As found in its images.
        found: The same, as it will be written.

    Raises:
        BadInput: If the depth images show no plane there, or one at another distance than the globe's size.
    """
    if Path(source).is_file() and split_source(source, SOURCES)[0] in ("video", "dicom"):
        return None
    opened = open_source(Config(SourceConfig(uri=source, depth=True)), VirtualClock())
    camera = opened.depth_camera
    if camera is None:
        opened.close()
        return None
    depth = _median(opened)
    if depth is None:
        return None
    try:
        return plane_of_face(depth, camera, anatomy, found)
    except ValueError as error:
        raise BadInput(f"depth: {error}", source) from None


def depth_line(plane: DepthPlane, mm_per_px: float) -> str:
    """Describe the section in depth, for the report."""
    share = plane.section_mm / (plane.focal_px * mm_per_px) - 1
    right, down = plane.tilt_deg
    warning = "; CHECK --diameter-mm AND THE CAMERA" if abs(share) > WARNING_SHARE else ""
    return (
        f"depth      section at {plane.section_mm:.1f} mm (sd {plane.section_sd_mm:.2f} mm), tilted by "
        f"({right:.1f}, {down:.1f}) deg (sd {plane.tilt_sd_deg:.1f} deg); {share:+.1%} from the globe's "
        f"scale{warning}"
    )


def plane_of_face(depth: DepthImage, camera: DepthCamera, anatomy: Anatomy, found: AnatomyPx) -> DepthPlane:
    """Fit a plane to the depths of the eye's cut face, robustly.

    Raises:
        ValueError: If there is none.
    """
    at_px, values = _face(depth, anatomy)
    rays = (at_px - np.array(camera.principal_px)) / camera.focal_px
    design = np.column_stack([np.ones(len(rays)), rays])  # one over the depth of a plane is linear in the ray
    inverse, sd = 1 / values, camera.inverse_sd_per_mm
    middle = float(np.median(inverse)) if len(inverse) else 0.0
    is_inlier = np.abs(inverse - middle) <= NEAR_SD * sd
    for _ in range(ROUNDS):
        if is_inlier.sum() < MIN_INLIER_SHARE * RINGS * RAYS:
            raise ValueError(
                "the eye's cut face is not visible as a plane; give it texture and light, or mount it flat"
            )
        answer = np.linalg.lstsq(design[is_inlier], inverse[is_inlier], rcond=None)[0]
        is_inlier = np.abs(inverse - design @ answer) <= OUTLIER_SD * sd
    area_px = 2 * math.pi * anatomy.rim.inner.radius_px * _width_px(anatomy)
    counted = max(area_px / ALIKE_PX**2, 3.0)
    chosen = design[is_inlier]
    covariance = sd**2 * np.linalg.inv(chosen.T @ chosen) * len(chosen) / min(counted, len(chosen))
    return _section(answer, covariance, camera, anatomy, found)


def _section(
    answer: Floats, covariance: Floats, camera: DepthCamera, anatomy: Anatomy, found: AnatomyPx
) -> DepthPlane:
    """Return the section behind a plane 1/depth = answer . (1, ray)."""
    slopes = -answer[1:] / answer[0]
    center = (np.array(found.center_px) - np.array(camera.principal_px)) / camera.focal_px
    towards = 1 - slopes @ center
    face_mm = 1 / (answer[0] * towards)
    rim_mm = face_mm * (anatomy.rim_ratio - 1)
    section_mm = face_mm + rim_mm * math.hypot(*slopes, 1) / towards
    scale = camera.focal_px * found.diameter_mm / (2 * found.radius_px) / section_mm
    if not 1 / MAX_SCALE <= scale <= MAX_SCALE:
        raise ValueError(
            f"the eye's cut face is at {face_mm:.0f} mm, but a globe of {found.diameter_mm:g} mm that "
            f"appears {2 * found.radius_px:.0f} px wide is at {section_mm * scale:.0f} mm; "
            "check --diameter-mm"
        )
    ray = np.array([1.0, *center])
    face_sd_mm = math.sqrt(ray @ covariance @ ray) * face_mm**2
    rim_sd_mm = face_mm * anatomy.rim_uncertainty_px / anatomy.rim.inner.radius_px
    tilt_sd_rad = math.hypot(
        math.sqrt(covariance[1:, 1:].trace() / 2) / answer[0],
        FLATNESS_MM / (math.sqrt(2) * found.diameter_mm / 2),
    )
    right, down = np.degrees(np.arctan(slopes)).tolist()
    return DepthPlane(
        focal_px=camera.focal_px,
        principal_px=camera.principal_px,
        disparity_px_mm=camera.disparity_px_mm,
        subpixel_px=camera.subpixel_px,
        section_mm=float(section_mm),
        section_sd_mm=math.hypot(face_sd_mm, rim_sd_mm, FLATNESS_MM),
        tilt_deg=(right, down),
        tilt_sd_deg=math.degrees(tilt_sd_rad),
    )


def _median(source: Source) -> DepthImage | None:
    """Return the median of a source's first depth images, 0 where few have a depth; None without any."""
    with closing(read_images(source)) as captures:
        images = [capture.depth for capture in islice(captures, MAX_IMAGES) if capture.depth is not None]
    if not images:
        return None
    first = images[0]
    stack = np.array(
        [image.values for image in images if image.values.shape == first.values.shape], np.float64
    )
    stack[stack == 0] = np.nan
    is_seen = np.isfinite(stack).mean(axis=0) >= MIN_SEEN_SHARE
    values = np.zeros(first.values.shape)
    values[is_seen] = np.nanmedian(stack[:, is_seen], axis=0)
    return DepthImage(np.rint(values).astype(np.uint16), first.unit_mm, first.left_px, first.top_px)


def _width_px(anatomy: Anatomy) -> float:
    """Return the width of the cut face in the image."""
    inner, outer = anatomy.rim.inner, anatomy.rim.outer
    return (outer.radius_px if outer else WALL_RATIO * inner.radius_px) - inner.radius_px


def _face(depth: DepthImage, anatomy: Anatomy) -> tuple[Floats, Floats]:
    """Return pixels of the cut face, (n, 2), and their depths, (n,)."""
    (x, y), inner_px, width_px = anatomy.rim.inner.center_px, anatomy.rim.inner.radius_px, _width_px(anatomy)
    shares = np.linspace(EDGE_SHARE, 1 - EDGE_SHARE, RINGS)
    angles = np.linspace(0, 2 * math.pi, RAYS, endpoint=False)
    points = [
        anatomy.image_px((x + radius * math.cos(angle), y + radius * math.sin(angle)))
        for radius in (inner_px + share * width_px for share in shares)
        for angle in angles.tolist()
    ]
    at_px = np.array(points)
    columns, rows = np.rint(at_px - (depth.left_px, depth.top_px)).astype(int).T
    height, width = depth.values.shape
    is_within = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    values = depth.values[rows[is_within], columns[is_within]] * depth.unit_mm
    return at_px[is_within][values > 0], values[values > 0]
