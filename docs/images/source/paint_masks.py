#!/usr/bin/env python3
"""Paints two masks on the map of the tongue's back, as one would by hand: 256 x 256 gray pixels, u to the right from the
patient's right border to the left, v upwards from the tip to the base.

    paint_masks.py FOLDER

`patches.png`: three patches of porphyrin across the middle. `geographic.png`: a bald red field in front, on the left. Needs
Python only.
"""

import math
import struct
import sys
import zlib

SIDE = 256


def write_gray(path, value):
    """Rows from the top, v = 1."""
    rows = b""
    for row in range(SIDE):
        v = 1.0 - (row + 0.5) / SIDE
        rows += b"\0" + bytes(round(255 * min(1.0, max(0.0, value((c + 0.5) / SIDE, v)))) for c in range(SIDE))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)))
        file.write(chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def blob(u, v, center_u, center_v, radius, lobes, turn):
    """1 inside a wavy circle, fading out over a tenth of its radius. A step of v is about 1.4 times as long as one of u."""
    x, y = u - center_u, 1.4 * (v - center_v)
    rim = radius * (1.0 + 0.25 * math.sin(lobes * math.atan2(y, x) + turn))
    return (rim - math.hypot(x, y)) / (0.1 * radius) + 0.5


def patches(u, v):
    return max(
        blob(u, v, 0.35, 0.32, 0.07, 3, 0.0),
        blob(u, v, 0.5, 0.42, 0.08, 4, 1.0),
        blob(u, v, 0.65, 0.34, 0.06, 3, 2.0),
    )


folder = sys.argv[1]
write_gray(f"{folder}/patches.png", patches)
write_gray(f"{folder}/geographic.png", lambda u, v: blob(u, v, 0.62, 0.17, 0.09, 5, 0.5))
