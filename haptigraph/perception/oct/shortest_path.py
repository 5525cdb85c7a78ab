"""The best path through an image from left to right, by dynamic programming (`native/bscan_surfaces.c`)."""

from haptigraph.perception.native.bscan import best_path

__all__ = ["best_path"]
