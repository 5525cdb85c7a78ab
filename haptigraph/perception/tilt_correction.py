"""Correct images once, for any perceiver: those of a tilted camera with a distorting lens become frontal."""

from msgspec.structs import replace

from haptigraph.imaging import tilt_corrected
from haptigraph.messages import Capture, Observation
from haptigraph.projection import ImageMap
from haptigraph.registration.camera import Registration
from haptigraph.stages import Perceiver

__all__ = ["TiltCorrectedPerceiver"]


class TiltCorrectedPerceiver:
    """Give a perceiver images that are corrected for the camera's tilt and its lens.

    Args:
        perceiver: Made for `registration.frontal`.
        registration: Of the camera.
        frontal_from_image: Its map to the frontal image.
    """

    def __init__(
        self, perceiver: Perceiver, registration: Registration, frontal_from_image: ImageMap
    ) -> None:
        self._perceiver = perceiver
        self._registration = registration
        self._frontal_from_image = frontal_from_image

    def __call__(self, capture: Capture) -> Observation:
        """Observe one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        image = self._registration.checked(capture.image)
        return self._perceiver(replace(capture, image=tilt_corrected(image, self._frontal_from_image)))

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()
