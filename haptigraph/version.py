"""The version of haptigraph, read by recordings, studies and the build."""

__all__ = ["__version__"]

__version__ = "0.2.0"
