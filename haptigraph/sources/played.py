"""Play a source to its end, as fast as it can be read: for what looks at all images and feels none."""

from collections.abc import Generator

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture
from haptigraph.stages import Source

__all__ = ["played"]

PATIENCE_S = 1.0


def played(source: Source) -> Generator[Capture, None, None]:
    """Yield every capture that has an image, and close the source."""
    try:
        while True:
            capture = source.read(PATIENCE_S)
            if capture is not None and capture.image is not None:
                yield capture
    except EndOfSource:
        return
    finally:
        source.close()
