"""Load registrations from files or text: of an eye before a camera, or of B-scans (those with `[scale]`)."""

from pathlib import Path

from haptigraph.registration.camera import Registration, camera_registration
from haptigraph.registration.oct import ScanRegistration, scan_registration
from haptigraph.toml_document import Document

__all__ = ["load_camera_registration", "load_registration", "parse_camera_registration", "parse_registration"]


def load_registration(path: str | Path) -> Registration | ScanRegistration:
    """Read and check a registration file of either kind.

    Raises:
        BadInput: With file, line and reason, if it cannot be read or is not valid.
    """
    return _registration(Document.read(path))


def parse_registration(text: str, file: str) -> Registration | ScanRegistration:
    """Read and check a registration of either kind from text; errors name it `file`."""
    return _registration(Document(text, file))


def load_camera_registration(path: str | Path) -> Registration:
    """Read and check the registration file of an eye before a camera; raises as `load_registration`."""
    return camera_registration(Document.read(path))


def parse_camera_registration(text: str, file: str) -> Registration:
    """Read and check the registration of an eye before a camera from text; errors name it `file`."""
    return camera_registration(Document(text, file))


def _registration(document: Document) -> Registration | ScanRegistration:
    return scan_registration(document) if "scale" in document.data else camera_registration(document)
