"""The version of haptigraph, where recordings, studies and the build read it."""

__all__ = ["__version__"]

__version__ = "0.1.0"
