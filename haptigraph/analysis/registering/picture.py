"""Draw a registration over the image it was found in, for visual inspection."""

from collections.abc import Sequence
from typing import TypeAlias

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.recording.codec import encode_png
from haptigraph.registration.camera import Registration
from haptigraph.registration.text import AnatomyPx

__all__ = ["draw_text", "registration_picture"]

GLOBE, RETINA, TROCAR, TARGET, WALL = (
    (255, 200, 60),
    (60, 60, 255),
    (40, 220, 255),
    (90, 230, 90),
    (200, 120, 200),
)
Color: TypeAlias = tuple[int, int, int]
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
SHIFT = 4  # fractional bits of coordinates in OpenCV's drawing functions
SCALE_BAR_MM = 5.0


def registration_picture(
    reference_image: Image,
    registration: Registration,
    found: AnatomyPx,
    uncertainty: str,
    anatomy: Anatomy | None,
) -> bytes:
    """Return a registration drawn over an image, as a PNG.

    Args:
        reference_image: The image.
        registration: The registration.
        found: The same registration in pixels.
        uncertainty: A caption.
        anatomy: Supplies the wall's outer edge, if it was found.
    """
    canvas = colored(reference_image).copy()
    if anatomy is not None and anatomy.rim.outer is not None:
        outer = anatomy.rim.outer
        circle = _circle_points(outer.center_px, outer.radius_px)
        _polyline(canvas, [anatomy.image_px(point) for point in circle], WALL, 1)
    globe = _circle_points((0.0, 0.0), registration.globe.radius_mm)
    _polyline(canvas, [registration.image.to_px(point_mm) for point_mm in globe], GLOBE, 1)
    _polyline(canvas, found.contour_px, RETINA, 2)
    for trocar in found.trocars:
        _circle(canvas, trocar.point_px, 6, TROCAR, 2)
        _label(canvas, f"{trocar.name}{' (used)' if trocar.used else ''}", trocar.point_px, TROCAR)
        if trocar.used:
            start, end = (
                np.round(np.array(p) * 2**SHIFT).astype(int).tolist()
                for p in (trocar.point_px, found.target_px)
            )
            cv2.line(canvas, start, end, TROCAR, 1, cv2.LINE_AA, SHIFT)
    _circle(canvas, found.target_px, 6, TARGET, 2)
    _label(canvas, f"target{' (assumed)' if 'target' in found.assumed else ''}", found.target_px, TARGET)
    _scale_bar(canvas, registration.image.mm_per_px)
    _label(canvas, uncertainty, (12, canvas.shape[0] - 44))
    return encode_png(canvas)


def draw_text(canvas: Image, text: str, left_bottom_px: tuple[int, int], color: Color = WHITE) -> None:
    """Write a text with a dark outline into an image."""
    for ink, thickness in ((BLACK, 3), (color, 1)):
        cv2.putText(canvas, text, left_bottom_px, cv2.FONT_HERSHEY_SIMPLEX, 0.5, ink, thickness, cv2.LINE_AA)


def _circle_points(center: Vec, radius_px: float) -> list[Vec]:
    angles = np.radians(np.arange(0, 361, 2))
    x, y = center[0] + radius_px * np.sin(angles), center[1] + radius_px * np.cos(angles)
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _polyline(canvas: Image, points_px: Sequence[Vec], color: Color, thickness: int) -> None:
    corners = np.round(np.array(points_px) * 2**SHIFT).astype(np.int32)
    cv2.polylines(canvas, [corners], False, color, thickness, cv2.LINE_AA, SHIFT)


def _circle(canvas: Image, center: Vec, radius_px: float, color: Color, thickness: int = 1) -> None:
    center_px = tuple(round(value * 2**SHIFT) for value in center)
    cv2.circle(canvas, center_px, round(radius_px * 2**SHIFT), color, thickness, cv2.LINE_AA, SHIFT)


def _label(canvas: Image, text: str, point_px: Vec, color: Color = WHITE) -> None:
    draw_text(canvas, text, (round(point_px[0]) + 10, round(point_px[1]) - 10), color)


def _scale_bar(canvas: Image, mm_per_px: float) -> None:
    length, bottom = round(SCALE_BAR_MM / mm_per_px), canvas.shape[0] - 20
    cv2.line(canvas, (20, bottom), (20 + length, bottom), WHITE, 2)
    _label(canvas, f"{SCALE_BAR_MM:g} mm", (12, bottom))
