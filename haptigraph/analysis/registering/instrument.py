"""Learn an instrument from a folder of volumes, and write its model."""

from pathlib import Path

from haptigraph.analysis.registering.registering import check_files
from haptigraph.perception.instrument.learning import Progress, learn_instrument
from haptigraph.perception.instrument.model import VoxelMm
from haptigraph.perception.instrument.model_file import check_suffix, fingerprint, save_instrument
from haptigraph.perception.instrument.volume_folder import VolumeFolder

__all__ = ["register_instrument"]


def register_instrument(
    folder: str, output: str, voxel_mm: VoxelMm, *, force: bool = False, progress: Progress | None = None
) -> str:
    """Learn an instrument, write its model, and return what to print.

    Raises:
        BadInput: If the volumes show no instrument, or the model cannot be written.
    """
    path = Path(output)
    check_suffix(path)
    check_files((path,), folder, force=force)
    volumes = VolumeFolder(folder)
    model = learn_instrument(volumes, voxel_mm, progress)
    save_instrument(model, path, force=force)
    tip = " x ".join(f"{sd * 1e3:.1f}" for sd in model.tip_sd_mm)
    reflections = int((~model.is_usable).sum())
    return (
        f"{path} was written: an instrument learned from {model.volumes} of {len(volumes)} volumes, "
        f"{len(model.values)} points, {reflections} rows of fixed reflections left out\n"
        f"standard deviations of a registration: tip {tip} µm (x, y, z), axis {model.axis_sd_deg:.2f}°, "
        f"roll {model.roll_sd_deg:.2f}°\n"
        f"sha256 {fingerprint(model)}"
    )
