"""Encode OpenIGTLink messages, version 1: TRANSFORM and STRING, as 3D Slicer reads them.

http://openigtlink.org/developers/spec: 58 bytes of header, then the body, all big-endian.
"""

import struct
from functools import cache

from haptigraph.bridges.needle_pose import Matrix

__all__ = ["crc64", "string", "transform"]

HEADER = struct.Struct(">H12s20sQQQ")
UTF8 = 106
"""IANA's number of this encoding."""
POLYNOMIAL = 0x42F0E1EBA9EA3693
"""CRC-64 of ECMA-182."""
ALL_BITS = (1 << 64) - 1


def transform(device: str, utc_ns: int, matrix: Matrix) -> bytes:
    """Return a TRANSFORM message.

    Args:
        device: Name in Slicer, up to 20 letters.
        utc_ns: Time stamp, nanoseconds since 1970.
        matrix: From the device's frame to RAS.
    """
    columns = [row[column] for column in range(4) for row in matrix]
    return _message("TRANSFORM", device, utc_ns, struct.pack(">12f", *columns))


def string(device: str, utc_ns: int, text: str) -> bytes:
    """Return a STRING message."""
    data = text.encode()[:65535]
    return _message("STRING", device, utc_ns, struct.pack(">HH", UTF8, len(data)) + data)


def crc64(data: bytes) -> int:
    """Return the checksum of a message body."""
    crc, table = 0, _crc_table()
    for byte in data:
        crc = table[(crc >> 56) ^ byte] ^ (crc << 8 & ALL_BITS)
    return crc


def _message(kind: str, device: str, utc_ns: int, body: bytes) -> bytes:
    sec, nsec = divmod(utc_ns, 1_000_000_000)
    stamp = sec << 32 | (nsec << 32) // 1_000_000_000
    header = HEADER.pack(1, kind.encode(), device.encode(), stamp, len(body), crc64(body))
    return header + body


@cache
def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = (crc << 1 ^ POLYNOMIAL if crc >> 63 else crc << 1) & ALL_BITS
        table.append(crc)
    return table
