"""The former name of `reading.read_images`."""

from haptigraph.sources.reading import read_images as played

__all__ = ["played"]
