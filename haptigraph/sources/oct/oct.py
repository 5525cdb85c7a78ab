"""OCT B-scans and volumes with their scale, from DICOM, vendors' files, images, or a video of a monitor.

Every image is one B-scan, axial direction down, or the B-scans of one volume side by side. The scale
is the file's or the user's, never a guess, and becomes the source's registration.
"""

from pathlib import Path

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.registration.assumed import TARGET
from haptigraph.registration.text import AXIAL_MM_PER_PX, LATERAL_MM_PER_PX, SLICE_MM, scan_registration_text
from haptigraph.sources.depth import DeepDecoder
from haptigraph.sources.images import SUFFIXES, ImagesSource
from haptigraph.sources.oct.crop import CropSource
from haptigraph.sources.oct.dicom import DicomSource
from haptigraph.sources.oct.scan import EYEPY_FILES, EyepySource, ScanFacts, dicom_facts
from haptigraph.sources.oct.volumes import VolumesSource, volume_files
from haptigraph.sources.video import VideoSource
from haptigraph.stages import Source

__all__ = ["OctSource", "resolve_scale"]

VIDEOS = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
SLICE = "slice_mm"
EXAMPLES = {"axial_mm_per_px": 0.0033, "lateral_mm_per_px": 0.0078, SLICE: 0.05}
SCALES = (
    ("axial scale", "axial_mm_per_px", AXIAL_MM_PER_PX),
    ("lateral scale", "lateral_mm_per_px", LATERAL_MM_PER_PX),
    ("distance between B-scans", SLICE, SLICE_MM),
)
UNREADABLE = {".img": "Zeiss's raw volume (.img)", ".fds": "Topcon's older format (.fds)"}
SAME_SCALE = 0.01  # relative; scales that differ by less agree
FIRST_IMAGE_TIMEOUT_S = 60.0


class OctSource(Source):
    """Play B-scans or volumes.

    Args:
        path: A DICOM file, a file that eyepy reads, a video, an image, a TIFF stack, a NumPy array, or a
            folder of images or volumes.
        settings: The scale if the file states none, crop, depth, rate, and how a volume is played.

    Raises:
        MissingExtra: If the library that reads such files is not installed.
        BadInput: If the file cannot be read, or its scale is unknown or implausible.
    """

    is_live = False

    def __init__(self, path: str, settings: SourceConfig) -> None:
        file = Path(path)
        source, facts = _opened(file, settings)
        try:
            scale: tuple[float, ...] | None = None
            is_volume = isinstance(source, VolumesSource) and not settings.volume_as_sequence
            if not settings.registration:  # which states the scale itself
                scale, self.notes = resolve_scale(facts, settings, file, is_volume=is_volume)
            self._source = CropSource(source, settings.crop_px, path) if settings.crop_px else source
            self.rate_hz = self._source.rate_hz
            self._first = self._source.read(FIRST_IMAGE_TIMEOUT_S)
        except EndOfSource:
            raise BadInput("contains no images", file) from None
        except BaseException:
            source.close()
            raise
        self.registration = self._registration(scale, source, file) if scale else None

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

    def _registration(self, scale: tuple[float, ...], source: Source, file: Path) -> str | None:
        if self._first is None or self._first.image is None:
            return None
        axial_mm, lateral_mm, *slice_mm = scale
        height, width = self._first.image.shape[:2]
        volume = None
        if slice_mm and isinstance(source, VolumesSource):
            (width, height), volume = source.size_px, (source.slices, slice_mm[0])
        title = f"Scale of the {'volumes' if volume else 'B-scans'} in {file.name}."
        return scan_registration_text(
            (width, height), axial_mm, lateral_mm, title, assumed=(TARGET,), volume=volume
        )


def resolve_scale(
    facts: ScanFacts, settings: SourceConfig, file: Path, *, is_volume: bool = False
) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Return the scale [mm], axial, lateral and of a volume between B-scans, and notes about it.

    Settings override the file.

    Raises:
        BadInput: If a scale is unknown, or implausible for OCT of the retina.
    """
    notes, scales = [], []
    for name, key, (low, high) in SCALES if is_volume else SCALES[:2]:
        of_file, of_user = getattr(facts, key), getattr(settings, key)
        scale = of_file if of_user is None else of_user
        if scale is None:
            raise BadInput(_unstated(facts, name, key), file)
        if not low <= scale <= high:
            origin = "the file states" if of_user is None else f"source.{key} is"
            raise BadInput(f"{origin} {scale:g} mm, {name}; {low:g} to {high:g} is plausible for OCT", file)
        if of_user is not None and of_file is not None and abs(of_user / of_file - 1) > SAME_SCALE:
            notes.append(f"{file}: source.{key}={of_user:g} overrides the {name} in the file, {of_file:g}")
        scales.append(scale)
    return tuple(scales), tuple(notes)


def _unstated(facts: ScanFacts, name: str, key: str) -> str:
    what, instead = "states", ""
    if key == SLICE:
        what = f"a volume: {facts.volume_reason}; it states"
        instead = (
            "; --set source.volume_as_sequence=true plays them as if they were repeated scans of one plane"
        )
    return (
        f"{what} no {name}, without which nothing can be measured in millimetres; set it, for example "
        f"--set source.{key}={EXAMPLES[key]}{instead}"
    )


def _opened(file: Path, settings: SourceConfig) -> tuple[Source, ScanFacts]:
    suffix, as_sequence = file.suffix.lower(), settings.volume_as_sequence
    if suffix in EYEPY_FILES:
        eyepy = EyepySource(file, settings.rate_hz)
        is_volume = eyepy.facts.volume_reason and not as_sequence
        return VolumesSource([file], settings, eyepy.facts, eyepy) if is_volume else eyepy, eyepy.facts
    if not file.exists():
        raise BadInput("no such file or folder", file)
    if files := volume_files(file):
        volumes = VolumesSource(files, settings)
        return volumes, volumes.facts
    if file.is_dir() or suffix in SUFFIXES:
        return ImagesSource(file, settings.rate_hz, DeepDecoder(settings.bits)), ScanFacts()
    if suffix in VIDEOS:
        return VideoSource(file), ScanFacts()
    if suffix in UNREADABLE:
        raise BadInput(f"{UNREADABLE[suffix]} cannot be read; export DICOM from the device", file)
    facts = dicom_facts(file)
    if facts.volume_reason and not as_sequence:
        return VolumesSource([file], settings, facts), facts
    return DicomSource(file, settings.rate_hz), facts
