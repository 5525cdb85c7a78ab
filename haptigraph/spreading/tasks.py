"""Where work is spread to, and what becomes of a task that kills its workers."""

from pathlib import Path
from urllib.parse import urlsplit

from msgspec import Struct

__all__ = ["ATTEMPTS", "Cluster", "Killed"]

ATTEMPTS = 4
"""Workers that may die of a task before it is given up; as Dask does."""
LOOPBACK = ("localhost", "127.0.0.1", "::1", None)


class Killed(Struct, frozen=True):
    """The result of a task that was given up, because every worker that tried it died."""

    problem: str = f"{ATTEMPTS} workers died of it, one after the other; out of memory?"


class Cluster(Struct, frozen=True):
    """A Dask cluster."""

    address: str
    """Of its scheduler, for example tcp://127.0.0.1:8786 or tls://lab-1:8786."""
    tls: Path | None = None
    """Folder with ca.pem, cert.pem and key.pem; None: no encryption."""

    @property
    def is_exposed(self) -> bool:
        """Whether anyone on a network may send code to the workers: no TLS, and not on this machine."""
        return self.tls is None and urlsplit(self.address).hostname not in LOOPBACK
