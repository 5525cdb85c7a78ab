"""Draw docs/images/soft-retina.png: a retina that is dented and springs back, enlarged.

python docs/soft_retina.py
"""

from pathlib import Path

import cv2
import numpy as np

from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

TIMES_S = (9.5, 14.1, 14.7, 16.5)
"""Before contact, pressed, just released, later."""
MAGNIFICATION = 3
LEFT, RIGHT, ABOVE, BELOW = 70, 50, 40, 28  # px around the target
LINE = (90, 60, 20)
SHIFT = 4  # sub-pixel bits


def main() -> None:
    """Play the scenario and tile its moments."""
    phantom = Phantom(load_scenario("soft_retina"))
    numbers = [round(time_s * phantom.scenario.about.rate_hz) for time_s in TIMES_S]
    moments = [phantom.advance(draws=number in numbers) for number in range(max(numbers) + 1)]
    geometry = phantom.camera.geometry
    x, y = np.rint(geometry.to_px(phantom.eye.target_mm)).astype(int)
    contour = np.array([geometry.to_px(point) for point in phantom.eye.retina_mm]) - (x - LEFT, y - ABOVE)
    panels = []
    for number in numbers:
        part = moments[number].image[y - ABOVE : y + BELOW, x - LEFT : x + RIGHT]
        panel = cv2.resize(part, None, fx=MAGNIFICATION, fy=MAGNIFICATION, interpolation=cv2.INTER_NEAREST)
        points = np.rint((contour * MAGNIFICATION + (MAGNIFICATION - 1) / 2) * 2**SHIFT).astype(np.int32)
        cv2.polylines(panel, [points], False, LINE, 1, cv2.LINE_AA, SHIFT)
        panels.append(cv2.copyMakeBorder(panel, 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    image = np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    path = Path(__file__).parent / "images" / "soft-retina.png"
    cv2.imwrite(str(path), image, (cv2.IMWRITE_PNG_COMPRESSION, 9))


if __name__ == "__main__":
    main()
