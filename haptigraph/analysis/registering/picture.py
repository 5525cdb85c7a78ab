"""Draw a registration over the picture it was found in, for a person to look at before trusting it."""

from collections.abc import Sequence
from typing import TypeAlias

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.registration.camera import Registration
from haptigraph.registration.text import AnatomyPx

__all__ = ["registration_picture"]

GLOBE, RETINA, TROCAR, TARGET, WALL = (
    (255, 200, 60),
    (60, 60, 255),
    (40, 220, 255),
    (90, 230, 90),
    (200, 120, 200),
)
Color: TypeAlias = tuple[int, int, int]
FINE = 4  # binary places of a pixel in OpenCV's drawing
SCALE_BAR_MM = 5.0


def registration_picture(
    still: Image, registration: Registration, found: AnatomyPx, doubt: str, anatomy: Anatomy | None
) -> bytes:
    """Return a PNG.

    Args:
        still: What is drawn over.
        registration: What is drawn.
        found: The same in pixels.
        doubt: Written into it.
        anatomy: What was seen in the image, if anything: the wall's outer edge.
    """
    canvas = colored(still).copy()
    if anatomy is not None and anatomy.rim.outer is not None:
        outer = anatomy.rim.outer
        _chain(canvas, [anatomy.seen_px(at) for at in _around(outer.center_px, outer.radius_px)], WALL, 1)
    globe = _around((0.0, 0.0), registration.globe.radius_mm)
    _chain(canvas, [registration.image.to_px(at_mm) for at_mm in globe], GLOBE, 1)
    _chain(canvas, found.contour_px, RETINA, 2)
    for trocar in found.trocars:
        _circle(canvas, trocar.point_px, 6, TROCAR, 2)
        _say(canvas, f"{trocar.name}{' (used)' if trocar.used else ''}", trocar.point_px, TROCAR)
        if trocar.used:
            start, end = (
                np.round(np.array(p) * 2**FINE).astype(int).tolist()
                for p in (trocar.point_px, found.target_px)
            )
            cv2.line(canvas, start, end, TROCAR, 1, cv2.LINE_AA, FINE)
    _circle(canvas, found.target_px, 6, TARGET, 2)
    _say(canvas, "target", found.target_px, TARGET)
    _scale_bar(canvas, registration.image.mm_per_px)
    _say(canvas, doubt, (12, canvas.shape[0] - 44), (255, 255, 255))
    done, png = cv2.imencode(".png", canvas)
    if not done:
        raise RuntimeError("OpenCV could not encode a PNG")
    return png.tobytes()


def _around(center: Vec, radius_px: float) -> list[Vec]:
    turns = np.radians(np.arange(0, 361, 2))
    x, y = center[0] + radius_px * np.sin(turns), center[1] + radius_px * np.cos(turns)
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _chain(canvas: Image, places_px: Sequence[Vec], color: Color, thick: int) -> None:
    corners = np.round(np.array(places_px) * 2**FINE).astype(np.int32)
    cv2.polylines(canvas, [corners], False, color, thick, cv2.LINE_AA, FINE)


def _circle(canvas: Image, center: Vec, radius_px: float, color: Color, thick: int = 1) -> None:
    place = tuple(round(value * 2**FINE) for value in center)
    cv2.circle(canvas, place, round(radius_px * 2**FINE), color, thick, cv2.LINE_AA, FINE)


def _say(canvas: Image, text: str, at_px: Vec, color: Color) -> None:
    place = round(at_px[0]) + 10, round(at_px[1]) - 10
    for ink, thick in (((0, 0, 0), 3), (color, 1)):
        cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, ink, thick, cv2.LINE_AA)


def _scale_bar(canvas: Image, mm_per_px: float) -> None:
    length, bottom = round(SCALE_BAR_MM / mm_per_px), canvas.shape[0] - 20
    cv2.line(canvas, (20, bottom), (20 + length, bottom), (255, 255, 255), 2)
    _say(canvas, f"{SCALE_BAR_MM:g} mm", (12, bottom), (255, 255, 255))
