"""Files in Heidelberg's format, written byte by byte, so that no reader is tested against itself."""

import struct
from pathlib import Path

import numpy as np

HEADER = "<12s3I3d2I2dId4sQiI16s16sI24sdI24sd4I34s1790x"
BSCAN_HEADER = "<12sI4d2IfI6f168x"


def heidelberg_vol(
    path: Path, scans: np.ndarray, axial_mm: float = 0.0039, lateral_mm: float = 0.0115
) -> Path:
    """Write B-scans, (n, h, w) uint8, as a .vol file: one is a line scan, several are a volume."""
    count, height, width = scans.shape
    before = 256 + 4 * width
    parts = [
        struct.pack(
            HEADER,
            b"HSF-OCT-103", width, count, height, lateral_mm, 0.1, axial_mm, 32, 32, 0.2, 0.2, 30, 0.0, b"OD",
            132_000_000_000_000_000, 1 if count == 1 else 3, before, b"1", b"", 1, b"nobody", 36526.0, 1, b"",
            43831.0, 0, 0, 0, 0, b"",
        ),
        bytes(32 * 32),
    ]  # fmt: skip
    for number, grey in enumerate(scans):
        position = 0.0, 0.1 * number, width * lateral_mm, 0.1 * number
        parts.append(struct.pack(BSCAN_HEADER, b"HSF-BS-103", before, *position, 1, 256, 30.0, 0, *[0.0] * 6))
        parts.append(np.zeros(width, np.float32).tobytes())
        shown = grey.astype(np.float64) / 255  # the device stores reflectivity, viewers display its logarithm
        parts.append((np.exp(shown * 8.285 - 8.3) - 2.44e-4).astype(np.float32).tobytes())
    path.write_bytes(b"".join(parts))
    return path
