"""How many pixels a JPEG, JPEG-LS or JPEG 2000 code says it holds.

Decoders allocate what the code itself says, not what the file around it describes: a damaged tile
of 100 bytes would take 13 GB. So its size is looked at first.
"""

from __future__ import annotations

import struct

_SOI = b"\xff\xd8"
_J2K_SIZ = b"\xff\x4f\xff\x51"
# A JP2 file puts a few boxes before its code.
_JP2_BOXES_NBYTES = 4096
# Start of frame of all kinds of JPEG, lossless ones too; the last is that of JPEG-LS.
_FRAMES = {*range(0xC0, 0xD0), 0xF7} - {0xC4, 0xC8, 0xCC}
_BARE = {0x01, *range(0xD0, 0xDA)}
_SCAN = 0xDA


def coded_npixels(code: bytes) -> int | None:
    """Pixels of an image, whatever its samples; None where the code does not say it."""
    if code.startswith(_SOI):
        return _jpeg(code)
    start = code[:_JP2_BOXES_NBYTES].find(_J2K_SIZ)
    if start >= 0 and len(code) >= start + 24:
        x1, y1, x0, y0 = struct.unpack_from(">IIII", code, start + 8)
        return max(0, int(x1) - int(x0)) * max(0, int(y1) - int(y0))
    return None


def _jpeg(code: bytes) -> int | None:
    position = 2
    while position + 9 <= len(code) and code[position] == 0xFF:
        marker = code[position + 1]
        if marker == 0xFF:
            position += 1
        elif marker in _BARE:
            position += 2
        elif marker in _FRAMES:
            ny, nx = struct.unpack_from(">HH", code, position + 5)
            return int(ny) * int(nx)
        elif marker == _SCAN:
            return None
        else:
            position += 2 + int(struct.unpack_from(">H", code, position + 2)[0])
    return None
