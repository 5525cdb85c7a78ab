"""The bundles that were made of a study: where they are, and under which names they contain whom.

`bundles.json` in the study's folder is the only link between the pseudonyms and the names in a bundle.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput
from haptigraph.study.checksums import CHECKSUMS

__all__ = ["REGISTRY", "Bundle", "bundles_of", "read_bundles", "register"]

REGISTRY = "bundles.json"


class Bundle(Struct, frozen=True, forbid_unknown_fields=True):
    """One bundle."""

    path: str
    """Where it was written; it may have been moved, and published."""
    made_utc: str
    sha256: str
    """Of its list of checksums."""
    participants: dict[str, str]
    """Name in the bundle by pseudonym, of everyone whose data it contains."""

    @property
    def is_there(self) -> bool:
        """Whether it is where it was written, and not another one."""
        checksums = Path(self.path) / CHECKSUMS
        return checksums.is_file() and sha256_of(checksums) == self.sha256

    def described(self, participant: str) -> str:
        """Return a line about a participant in it."""
        gone = "" if self.is_there else "; no longer there: moved or deleted"
        return (
            f"{self.path} (as {self.participants[participant]}; made {self.made_utc[:10]}, "
            f"SHA-256 of SHA256SUMS {self.sha256[:12]}...{gone})"
        )


def read_bundles(folder: Path) -> list[Bundle]:
    """Return the bundles of a study, the oldest first.

    Raises:
        BadInput: If the file cannot be read or is damaged.
    """
    path = folder / REGISTRY
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Bundle])
    except FileNotFoundError:
        return []
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        problem = (
            f"is damaged ({error}); restore it, or delete it and look for the participant in your bundles"
        )
        raise BadInput(problem, path) from None


def bundles_of(folder: Path, participant: str) -> Iterator[Bundle]:
    """Yield the bundles that contain a participant's data."""
    return (bundle for bundle in read_bundles(folder) if participant in bundle.participants)


def register(folder: Path, bundle: Bundle) -> None:
    """Add a bundle to the list, before it gets its final name, so that none goes unlisted.

    Raises:
        BadInput: If the list is damaged or cannot be written.
    """
    path = folder / REGISTRY
    bundles = [*read_bundles(folder), replace(bundle, path=str(Path(bundle.path).absolute()))]
    new = path.with_name(f"{REGISTRY}.part")
    try:
        new.write_bytes(msgspec.json.format(msgspec.json.encode(bundles), indent=1) + b"\n")
        os.replace(new, path)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise BadInput(f"cannot be written ({error.strerror})", path) from None
