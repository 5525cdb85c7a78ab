"""B-scans of an optical coherence tomograph, with their scale.

From DICOM, makers' files, images, or a monitor's video; every image is one B-scan, axial direction down. The
scale is the file's own or the user's, never a guess, and becomes the registration that the source brings
along. Knows nothing of what a B-scan shows.
"""

from pathlib import Path

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.registration.text import AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, scan_registration_text
from haptigraph.sources.depth import DeepDecoder, pages
from haptigraph.sources.images import SUFFIXES, ImagesSource
from haptigraph.sources.oct.crop import CropSource
from haptigraph.sources.oct.dicom import DicomSource
from haptigraph.sources.oct.scan import EYEPY_FILES, EyepySource, ScanFacts, dicom_facts
from haptigraph.sources.video import VideoSource
from haptigraph.stages import Source

__all__ = ["OctSource", "settled_scale"]

VIDEOS = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
EXAMPLES = {"axial": 0.0033, "lateral": 0.0078}
UNREADABLE = {".img": "Zeiss's raw volume (.img)", ".fds": "Topcon's older format (.fds)"}
SAME = 0.01  # scales that differ by less say the same
FOREVER_S = 60.0


class OctSource:
    """Play B-scans.

    Args:
        path: A DICOM file, a file that eyepy reads, a video, an image, or a folder of images.
        asked: The scale where the file states none, crop, depth, rate, and whether a volume may be played.

    Raises:
        MissingExtra: If the library that reads such files is not installed.
        BadInput: If it cannot be read, its scale is not known or makes no sense, or it is a volume.
    """

    is_live = False

    def __init__(self, path: str, asked: SourceConfig) -> None:
        file = Path(path)
        source, facts = _opened(file, asked)
        try:
            if facts.volume and not asked.volume_as_sequence:
                raise BadInput(
                    f"a volume, not a B-scan: {facts.volume}; --set source.volume_as_sequence=true plays "
                    "them one after the other, as if the needle's plane had been scanned again and again",
                    file,
                )
            self.notes: tuple[str, ...] = ()
            scale: tuple[float, float] | None = None
            if not asked.registration:  # which states the scale itself
                scale, self.notes = settled_scale(facts, asked, file)
            self._source = CropSource(source, asked.crop_px, path) if asked.crop_px else source
            self.rate_hz = self._source.rate_hz
            self._first = self._source.read(FOREVER_S)
        except EndOfSource:
            raise BadInput("has no images", file) from None
        except BaseException:
            source.close()
            raise
        self.registration = scale and self._registration(scale, file)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next B-scan.

        Raises:
            BadInput: If it cannot be decoded.
        """
        capture, self._first = self._first or self._source.read(timeout_s), None
        return capture

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def _registration(self, scale: tuple[float, float], file: Path) -> str | None:
        if self._first is None or self._first.image is None:
            return None
        height, width = self._first.image.shape[:2]
        return scan_registration_text((width, height), *scale, f"Scale of the B-scans in {file.name}.")


def settled_scale(
    facts: ScanFacts, asked: SourceConfig, file: Path
) -> tuple[tuple[float, float], tuple[str, ...]]:
    """Return axial and lateral scale [mm/px], and what to tell about them: the user's word before the file's.

    Raises:
        BadInput: If one is unknown, or is none of an OCT of the retina.
    """
    notes, settled = [], []
    for name, (least, most) in (("axial", AXIAL_MM_PER_PX), ("lateral", LATERAL_MM_PER_PX)):
        key = f"{name}_mm_per_px"
        of_file, of_user = getattr(facts, key), getattr(asked, key)
        scale = of_file if of_user is None else of_user
        if scale is None:
            raise BadInput(
                f"states no {name} scale, and without it nothing can be said in millimetres; give the size "
                f"of a pixel, for example --set source.{key}={EXAMPLES[name]}",
                file,
            )
        if not least <= scale <= most:
            whose = "the file states" if of_user is None else f"source.{key} is"
            raise BadInput(
                f"{whose} {scale:g} mm per pixel, {name}; {least:g} to {most:g} is plausible for OCT", file
            )
        if of_user is not None and of_file is not None and abs(of_user / of_file - 1) > SAME:
            notes.append(
                f"{file}: the file states {of_file:g} mm per pixel, {name}; source.{key}={of_user:g} counts"
            )
        settled.append(scale)
    return (settled[0], settled[1]), tuple(notes)


def _opened(file: Path, asked: SourceConfig) -> tuple[Source, ScanFacts]:
    suffix = file.suffix.lower()
    if suffix in EYEPY_FILES:
        eyepy = EyepySource(file, asked.rate_hz)
        return eyepy, eyepy.facts
    if not file.exists():
        raise BadInput("no such file or folder", file)
    if file.is_dir() or suffix in SUFFIXES:
        if file.is_file() and (count := pages(file)) > 1:
            raise BadInput(f"a volume, not a B-scan: {count} pictures; save them as one file each", file)
        return ImagesSource(file, asked.rate_hz, DeepDecoder(asked.bits)), ScanFacts()
    if suffix in VIDEOS:
        return VideoSource(file), ScanFacts()
    if suffix in UNREADABLE:
        raise BadInput(f"{UNREADABLE[suffix]} cannot be read; export DICOM from the device", file)
    facts = dicom_facts(file)
    return DicomSource(file, asked.rate_hz), facts
