from contextlib import closing

import numpy as np
import pytest

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture
from haptigraph.sources.played import played


class Listed:
    """A source of what a list says: images, moments without one, and nothing yet."""

    def __init__(self):
        image = np.zeros((2, 2), np.uint8)
        self.left = [Capture(0, 0, image), None, Capture(1, 1, None), Capture(2, 2, image)]
        self.closed = 0

    def read(self, timeout_s):
        if not self.left:
            raise EndOfSource
        return self.left.pop(0)

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("wanted", [[0, 2], [0]])
def test_images_come_in_order_and_the_source_is_closed_however_many_are_taken(wanted):
    source = Listed()
    with closing(played(source)) as captures:
        taken = [capture.index for capture, _ in zip(captures, wanted, strict=False)]
    assert taken == wanted
    assert source.closed == 1
