"""Check whether the picture is upright, and whether it is mirrored as registered.

Evidence: the reference image, the port openings, what moves outside the eye, the mark of the target, the rig.
"""

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.target import found_mark, registered_deg
from haptigraph.analysis.rig_check.view import View, wrapped_deg
from haptigraph.findings import Finding
from haptigraph.imaging import FloatImage, Mask, colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.perception.anatomy.upright import MAX_SHARE_ABOVE, share_above
from haptigraph.registration.assumed import MIRROR
from haptigraph.registration.camera import anatomy_px
from haptigraph.rig.description import Rig

__all__ = ["mirroring", "uprightness"]

CANONICAL_PX, REACH_RATIO = (
    256,
    1.5,
)  # of the pictures that are compared: side, and half of it over the radius
DETAIL_PX = 6.0  # details are smaller than this
MIN_ALIKE, MIN_BETTER = (
    0.25,
    0.12,
)  # correlation of a picture that is turned, and its lead over the upright one
PORT_DEG = 5.0  # between a port opening and where it is expected
MIN_ASYMMETRY_DEG = 2 * PORT_DEG  # of trocars by which mirroring is observable
MARK_DEG = 4.0  # of a target from the bottom, for mirroring to be observable
SIDE_DEG = 20.0  # around a trocar: where a needle in it is just outside the eye
MIN_SIDE_SHARE, MAX_SIDE_SHARE = 0.5, 0.05  # of what moves, on the other and on the registered side


Correlation: TypeAlias = float


class _Alike(NamedTuple):
    """Correlation of the picture's details with the reference image, as it is and turned."""

    as_is: Correlation
    mirrored: Correlation
    rotated: Correlation
    flipped: Correlation
    """Upside down and mirrored: top and bottom are exchanged."""


def uprightness(view: View) -> Subject:
    """Judge whether the picture is upright."""
    if view.rim is None:
        return Subject("upright", not_judged="no rim of an eye was found")
    alike, moves = _alike(view), view.moving
    measured = _measured(alike)
    evidence = []
    if alike and _turned(alike, max(alike.rotated, alike.flipped)):
        evidence.append("the picture resembles the reference image only when it is turned")
    upright, below = _matches(view, view.ports_deg), _matches(view, view.ports_below_deg)
    if below > upright and below > 1:
        evidence.append("the port openings are below instead of above")
    if moves is not None and share_above(moves, view.rim) < MAX_SHARE_ABOVE:
        evidence.append("what moves enters the eye from below")
    findings = tuple(
        Finding(
            "upside_down",
            f"{sentence}; ports on top are valid: turn the camera, or set source.rotate_deg and register "
            "again",
        )
        for sentence in evidence[:1]
    )
    is_judged = alike is not None or upright > 0 or below > 1 or moves is not None
    reason = "there is no reference image, no port opening is visible, and nothing moves outside the eye"
    return Subject("upright", measured, findings, "" if is_judged else reason)


def mirroring(view: View, rig: Rig | None) -> Subject:
    """Judge whether the picture is mirrored as the registration says."""
    findings = tuple(
        Finding(
            "mirror",
            f"{sentence}: correct the mirror flag (register again with --mirrored or --not-mirrored), or set "
            "source.mirror as it was",
        )
        for sentence in _mirror_evidence(view, rig)
    )
    if rig is None:
        reason = "without --rig nothing says through how many mirrors the camera looks"
        assumed = ", and the registration assumes it" if MIRROR in view.registration.assumed else ""
        return Subject("mirroring", findings=findings, not_judged=f"{reason}{assumed}")
    return Subject("mirroring", findings=findings)


def _mirror_evidence(view: View, rig: Rig | None) -> Iterator[str]:
    registered = view.registration.image.mirrored
    if rig is not None and registered != (rig.mirrored != view.registration.turn.mirror):
        yield (
            f"the registration says the picture is {'' if registered else 'not '}mirrored, but the rig has "
            f"{len(rig.mirrors)} mirror{'' if len(rig.mirrors) == 1 else 's'}"
        )
    if wrong := _misnamed(view):
        yield f"the trocar named {wrong} is on the surgeon's other side"
    if view.rim is None:
        return
    if (alike := _alike(view)) and _turned(alike, max(alike.mirrored, alike.flipped)):
        yield "the picture resembles the reference image only when left and right are exchanged"
    elif _ports_are_mirrored(view):
        yield "the port openings are where the registered trocars would be in a mirrored picture"
    elif (mark := found_mark(view)) and _is_opposite(mark.angle_deg, registered_deg(view)):
        yield "the mark on the retina is where the registered target would be in a mirrored picture"
    elif _enters_opposite(view):
        yield (
            "what moves enters the eye at the side opposite to the trocar in use, so that left and right are "
            "exchanged, or another trocar is used than registered (--trocar)"
        )


def _turned(alike: _Alike, other: float) -> bool:
    return other == max(alike) and other > MIN_ALIKE and other - alike.as_is > MIN_BETTER


def _measured(alike: _Alike | None) -> dict[str, float]:
    return {f"{name}_correlation": value for name, value in alike._asdict().items()} if alike else {}


def _alike(view: View) -> _Alike | None:
    """Correlate the picture with the reference image; None if there is none with a rim."""
    background, rim = view.registration.background, view.rim
    if background is None or rim is None or view.reference_rim is None:
        return None
    known = _canonical(background.is_known.astype(np.uint8), view.reference_rim) > 0
    reference = _details(_canonical(background.image, view.reference_rim))
    now = _details(_canonical(view.image, rim))
    turned = now, now[:, ::-1], now[::-1, ::-1], now[::-1]
    return _Alike(*(_correlation(reference, each, known) for each in turned))


def _canonical(image: Image, rim: Rim) -> Image:
    """Return the eye in a square picture of fixed size, its rim about the middle."""
    scale = CANONICAL_PX / (2 * REACH_RATIO * rim.inner.radius_px)
    (x, y), middle = rim.inner.center_px, (CANONICAL_PX - 1) / 2
    matrix = np.array([[scale, 0, middle - scale * x], [0, scale, middle - scale * y]])
    size = CANONICAL_PX, CANONICAL_PX
    return np.asarray(cv2.warpAffine(image, matrix, size, flags=cv2.INTER_AREA), np.uint8)


def _details(image: Image) -> FloatImage:
    color = colored(image).astype(np.float32)
    return np.asarray(color - cv2.GaussianBlur(color, (0, 0), DETAIL_PX), np.float32)


def _correlation(one: FloatImage, other: FloatImage, known: Mask) -> float:
    return float(np.corrcoef(one[known].ravel(), other[known].ravel())[0, 1])


def _matches(view: View, ports_deg: tuple[float, ...], sign: int = 0) -> int:
    """Return how many trocars have a port opening, as registered (1), mirrored (-1) or either (0)."""
    signs = (1, -1) if sign == 0 else (sign,)
    return max(
        sum(any(abs(each - one * port) < PORT_DEG for port in ports_deg) for each in view.trocars_deg)
        for one in signs
    )


def _ports_are_mirrored(view: View) -> bool:
    off_deg = [min(abs(each + other) for other in view.trocars_deg) for each in view.trocars_deg]
    if max(off_deg) < MIN_ASYMMETRY_DEG:
        return False
    mirrored = _matches(view, view.ports_deg, -1)
    return mirrored == len(view.trocars_deg) and mirrored > _matches(view, view.ports_deg, 1)


def _is_opposite(found_deg: float, registered_at_deg: float) -> bool:
    return abs(registered_at_deg) > MARK_DEG and abs(found_deg + registered_at_deg) < MARK_DEG / 2


def _misnamed(view: View) -> str:
    """Return the name of a trocar that says left or right wrongly; empty if there is none."""
    data = anatomy_px(view.registration)
    for trocar in data.trocars:
        side = "right" if (trocar.point_px[0] > data.center_px[0]) != data.mirrored else "left"
        if trocar.name.startswith(("left", "right")) and not trocar.name.startswith(side):
            return trocar.name
    return ""


def _enters_opposite(view: View) -> bool:
    """Return whether what moves just outside the eye is opposite to the trocar in use, and not at it."""
    moves = view.moving
    if moves is None:
        return False
    rows, columns = moves.nonzero()
    (x, y), used_deg = view.found_center_px, view.trocars_deg[0]
    angles_deg = np.degrees(np.arctan2(columns - x, y - rows))
    at, opposite = (
        float(np.mean(np.abs(wrapped_deg(angles_deg - side * used_deg)) < SIDE_DEG)) for side in (1, -1)
    )
    return at < MAX_SIDE_SHARE and opposite > MIN_SIDE_SHARE
