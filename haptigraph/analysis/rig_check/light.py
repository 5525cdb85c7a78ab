"""Check the light: brightness, saturation, noise, steadiness, and the contrast of the wall."""

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.imaging import Floats, Mask, grey_of
from haptigraph.perception.anatomy.port_opening import WHITE_GREY

__all__ = ["light"]

MIN_BRIGHTEST_GREY = 100.0
"""Of the brightest percent of globe and wall; below about 128 the tracker amplifies the image."""
MAX_WHITE_SHARE = 0.03
"""Of the bowl that is saturated in all colours."""
MAX_NOISE_SHARE = 0.04
"""Standard deviation of the noise, as a share of the brightest grey."""
MAX_UNSTEADY_SHARE = 0.05
"""Standard deviation of the light from image to image, as a share of its mean."""
MIN_CONTRAST_GREY = 3.0
"""Between bowl and wall on either side of the rim."""
WALL_RATIO = 1.1  # of the radius: globe and wall
RIM_RATIOS = 0.97, 1.03  # of the radius: on either side of the rim
TILE_PX = 16


def light(view: View) -> Subject:
    """Judge the light."""
    globe, bowl = _disc(view, WALL_RATIO), _disc(view, 1.0)
    grey = grey_of(view.image)
    noise_grey, unsteady_share = _noise_and_unsteadiness(view)
    brightest = float(np.percentile(grey[globe], 99))
    measured = {
        "mean_grey": float(grey[globe].mean()),
        "brightest_grey": brightest,
        "white_share": float(np.mean(view.image[bowl].min(axis=1) >= WHITE_GREY)),
        "noise_grey": noise_grey,
        "noise_share": noise_grey / max(brightest, 1.0),
        "unsteady_share": unsteady_share,
        "contrast_grey": _contrast_grey(view),
    }
    return Subject("light", measured, tuple(_findings(measured)))


def _findings(measured: dict[str, float]) -> Iterator[Finding]:
    if (brightest := measured["brightest_grey"]) < MIN_BRIGHTEST_GREY:
        yield Finding(
            "dim",
            f"the brightest parts of globe and wall have {brightest:.0f} of 255 grey levels; at least "
            f"{MIN_BRIGHTEST_GREY:.0f} is valid: use more light or a longer exposure",
        )
    if (white := measured["white_share"]) > MAX_WHITE_SHARE:
        yield Finding(
            "overexposed",
            f"{white:.1%} of the bowl is saturated; at most {MAX_WHITE_SHARE:.0%} is valid: use less light, "
            "a shorter exposure, or a diffuser",
        )
    if (noise := measured["noise_share"]) > MAX_NOISE_SHARE:
        yield Finding(
            "noise",
            f"the noise is {measured['noise_grey']:.1f} grey levels, {noise:.1%} of the brightest parts; at "
            f"most {MAX_NOISE_SHARE:.0%} is valid: use more light and less gain",
        )
    if (unsteady := measured["unsteady_share"]) > MAX_UNSTEADY_SHARE:
        yield Finding(
            "light_unsteady",
            f"the light varies by {unsteady:.1%} from image to image; at most {MAX_UNSTEADY_SHARE:.0%} is "
            "valid: fix exposure and white balance, and shade the rig from lamps that flicker",
        )
    if (contrast := measured["contrast_grey"]) < MIN_CONTRAST_GREY:
        yield Finding(
            "contrast",
            f"bowl and wall differ by {contrast:.1f} grey levels at the rim; at least {MIN_CONTRAST_GREY:g} "
            "are valid: light the cut face more than the bowl, or paint the bowl",
        )


def _disc(view: View, ratio: float) -> Mask:
    (x, y), radius_px = view.center_px, ratio * view.radius_px
    rows, columns = np.ogrid[: view.image.shape[0], : view.image.shape[1]]
    return np.asarray((columns - x) ** 2 + (rows - y) ** 2 < radius_px**2)


def _contrast_grey(view: View) -> float:
    """Return the median colour difference across the rim."""
    radii = np.array(RIM_RATIOS) * view.found_radius_px
    inside, outside = np.moveaxis(view.samples_at_deg(np.arange(0.0, 360.0, 2.0), radii), 1, 0)
    return float(np.median(np.sqrt(np.mean((inside - outside) ** 2, axis=1))))


def _noise_and_unsteadiness(view: View) -> tuple[float, float]:
    """Return the noise of a pixel [grey levels], and the light's relative deviation from image to image.

    Both are medians over tiles, of which what moves covers few.
    """
    means = np.stack([_tiles(image) for image in view.clip.consecutive])
    differences = [
        np.sqrt(_tiles(cv2.absdiff(one, other).astype(np.float32) ** 2))
        for one, other in pairwise(view.clip.consecutive)
    ]
    noise = float(np.median(np.median(differences, axis=0)) / np.sqrt(2))
    gains = np.median(means / np.maximum(means.mean(axis=0), 1.0), axis=(1, 2))
    return noise, float(gains.std())


def _tiles(image: "np.ndarray") -> Floats:
    """Return the mean of every tile."""
    height, width = image.shape
    size = max(width // TILE_PX, 1), max(height // TILE_PX, 1)
    return cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA).astype(np.float64)
