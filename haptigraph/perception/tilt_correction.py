"""Images by a camera that looks at a slant, turned into those of one that looks straight at the section.

The one place where a slant is taken away: perceivers behind it know nothing of it.
"""

from msgspec.structs import replace

from haptigraph.geometry import Homography
from haptigraph.imaging import tilt_corrected
from haptigraph.messages import Capture, Observation
from haptigraph.registration.camera import Registration
from haptigraph.stages import Perceiver

__all__ = ["TiltCorrectedPerceiver"]


class TiltCorrectedPerceiver:
    """Let a perceiver look at straightened images.

    Args:
        perceiver: It has been given `registration.frontal`.
        registration: Says how the camera looks at the section.
        frontal_from_image: Its homography.
    """

    def __init__(
        self, perceiver: Perceiver, registration: Registration, frontal_from_image: Homography
    ) -> None:
        self._perceiver = perceiver
        self._registration = registration
        self._frontal_from_image = frontal_from_image

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        image = self._registration.checked(capture.image)
        return self._perceiver(replace(capture, image=tilt_corrected(image, self._frontal_from_image)))

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()
