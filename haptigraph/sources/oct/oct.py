"""OCT B-scans with their scale, from DICOM, vendors' files, images, or a video of a monitor.

Every image is one B-scan, axial direction down. The scale is the file's or the user's, never a guess, and
becomes the source's registration.
"""

from pathlib import Path

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.registration.assumed import TARGET
from haptigraph.registration.text import AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, scan_registration_text
from haptigraph.sources.depth import DeepDecoder, pages
from haptigraph.sources.images import SUFFIXES, ImagesSource
from haptigraph.sources.oct.crop import CropSource
from haptigraph.sources.oct.dicom import DicomSource
from haptigraph.sources.oct.scan import EYEPY_FILES, EyepySource, ScanFacts, dicom_facts
from haptigraph.sources.video import VideoSource
from haptigraph.stages import Source

__all__ = ["OctSource", "resolve_scale"]

VIDEOS = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
EXAMPLES = {"axial": 0.0033, "lateral": 0.0078}
UNREADABLE = {".img": "Zeiss's raw volume (.img)", ".fds": "Topcon's older format (.fds)"}
SAME_SCALE = 0.01  # relative; scales that differ by less agree
FIRST_IMAGE_TIMEOUT_S = 60.0


class OctSource(Source):
    """Play B-scans.

    Args:
        path: A DICOM file, a file that eyepy reads, a video, an image, or a folder of images.
        settings: The scale if the file states none, crop, depth, rate, and whether a volume may be played.

    Raises:
        MissingExtra: If the library that reads such files is not installed.
        BadInput: If the file cannot be read, its scale is unknown or implausible, or it is a volume.
    """

    is_live = False

    def __init__(self, path: str, settings: SourceConfig) -> None:
        file = Path(path)
        source, facts = _opened(file, settings)
        try:
            if facts.volume_reason and not settings.volume_as_sequence:
                raise BadInput(
                    f"a volume, not a B-scan: {facts.volume_reason}; --set source.volume_as_sequence=true "
                    "plays them in order, as if they were repeated scans of one plane",
                    file,
                )
            scale: tuple[float, float] | None = None
            if not settings.registration:  # which states the scale itself
                scale, self.notes = resolve_scale(facts, settings, file)
            self._source = CropSource(source, settings.crop_px, path) if settings.crop_px else source
            self.rate_hz = self._source.rate_hz
            self._first = self._source.read(FIRST_IMAGE_TIMEOUT_S)
        except EndOfSource:
            raise BadInput("contains no images", file) from None
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
        title = f"Scale of the B-scans in {file.name}."
        return scan_registration_text((width, height), *scale, title, assumed=(TARGET,))


def resolve_scale(
    facts: ScanFacts, settings: SourceConfig, file: Path
) -> tuple[tuple[float, float], tuple[str, ...]]:
    """Return axial and lateral scale [mm/px] and notes about them; settings override the file.

    Raises:
        BadInput: If a scale is unknown, or implausible for OCT of the retina.
    """
    notes, scales = [], []
    for name, (low, high) in (("axial", AXIAL_MM_PER_PX), ("lateral", LATERAL_MM_PER_PX)):
        key = f"{name}_mm_per_px"
        of_file, of_user = getattr(facts, key), getattr(settings, key)
        scale = of_file if of_user is None else of_user
        if scale is None:
            raise BadInput(
                f"states no {name} scale, without which nothing can be measured in millimetres; set the size "
                f"of a pixel, for example --set source.{key}={EXAMPLES[name]}",
                file,
            )
        if not low <= scale <= high:
            origin = "the file states" if of_user is None else f"source.{key} is"
            raise BadInput(
                f"{origin} {scale:g} mm per pixel, {name}; {low:g} to {high:g} is plausible for OCT", file
            )
        if of_user is not None and of_file is not None and abs(of_user / of_file - 1) > SAME_SCALE:
            notes.append(
                f"{file}: source.{key}={of_user:g} overrides the {name} scale in the file, {of_file:g}"
            )
        scales.append(scale)
    return (scales[0], scales[1]), tuple(notes)


def _opened(file: Path, settings: SourceConfig) -> tuple[Source, ScanFacts]:
    suffix = file.suffix.lower()
    if suffix in EYEPY_FILES:
        eyepy = EyepySource(file, settings.rate_hz)
        return eyepy, eyepy.facts
    if not file.exists():
        raise BadInput("no such file or folder", file)
    if file.is_dir() or suffix in SUFFIXES:
        if file.is_file() and (count := pages(file)) > 1:
            raise BadInput(f"a volume, not a B-scan: {count} images; save each as a file", file)
        return ImagesSource(file, settings.rate_hz, DeepDecoder(settings.bits)), ScanFacts()
    if suffix in VIDEOS:
        return VideoSource(file), ScanFacts()
    if suffix in UNREADABLE:
        raise BadInput(f"{UNREADABLE[suffix]} cannot be read; export DICOM from the device", file)
    facts = dicom_facts(file)
    return DicomSource(file, settings.rate_hz), facts
