"""How different two colours look, also with a colour-vision deficiency, and whether text on one is readable.

Turns colours ("#rrggbb") into CIELAB differences and WCAG contrasts.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["contrast", "difference", "ink_on", "least_difference"]

VISIONS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""What is seen of linear RGB: Machado, Oliveira and Fernandes 2009, severity 1."""
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = XYZ.sum(axis=1)
DARK, BRIGHT = "#000000", "#ffffff"


def contrast(color: str, other: str) -> float:
    """Return the contrast ratio of two colours by WCAG 2, 1 to 21."""
    low, high = sorted(float(XYZ[1] @ _linear(each)) for each in (color, other))
    return (high + 0.05) / (low + 0.05)


def ink_on(color: str) -> str:
    """Return black or white, whichever is more readable on a colour; its contrast is 4.5 or more."""
    return max(DARK, BRIGHT, key=lambda ink: contrast(ink, color))


def difference(color: str, other: str, vision: str = "normal") -> float:
    """Return the distance of two colours in CIELAB.

    Args:
        color: One.
        other: The other.
        vision: A key of `VISIONS`.
    """
    seen = (VISIONS[vision] @ _linear(each) for each in (color, other))
    one, another = (_lab(np.clip(each, 0, 1)) for each in seen)
    return float(np.linalg.norm(one - another))


def least_difference(color: str, other: str) -> float:
    """Return the smallest distance of two colours in CIELAB, over normal vision and its deficiencies."""
    return min(difference(color, other, vision) for vision in VISIONS)


def _linear(color: str) -> NDArray[np.float64]:
    """Return linear RGB, (3,), in [0, 1]."""
    srgb = np.array([int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    share = XYZ @ linear / WHITE
    x, y, z = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])
