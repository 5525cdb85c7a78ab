"""DICOM files like those of cameras and OCT, with the elements that matter for pixels and time."""

from pathlib import Path

import numpy as np
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, OphthalmicTomographyImageStorage, generate_uid


def dicom(images: np.ndarray, kind: str = "MONOCHROME2", bits: int = 8, **elements) -> Dataset:
    """A data set with images, (n, h, w) or (n, h, w, 3), stored unchanged."""
    data = Dataset()
    data.file_meta = FileMetaDataset()
    data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    data.SOPClassUID = data.file_meta.MediaStorageSOPClassUID = OphthalmicTomographyImageStorage
    data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = generate_uid(
        entropy_srcs=["haptigraph"]
    )
    data.PhotometricInterpretation = kind
    data.SamplesPerPixel = 3 if images.ndim == 4 else 1
    if images.ndim == 4:
        data.PlanarConfiguration = 0
    if len(images) > 1:
        data.NumberOfFrames = len(images)
    data.Rows, data.Columns = images.shape[1:3]
    data.BitsAllocated = 8 * images.dtype.itemsize
    data.BitsStored, data.HighBit = bits, bits - 1
    data.PixelRepresentation = int(images.dtype.kind == "i")
    for name, value in elements.items():
        setattr(data, name, value)
    stored = images.tobytes()
    data.PixelData = stored + b"\0" * (len(stored) % 2)
    return data


def write(path: Path, data: Dataset) -> Path:
    data.save_as(path, enforce_file_format=True)
    return path
