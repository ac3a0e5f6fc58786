#!/usr/bin/env python3
"""Makes a noisy PNG smaller: means of two by two pixels with --half, 8-bit colors rounded to STEPS levels per channel.

    shrink_png.py FILE.png STEPS [--half]

The noise of the image hides the steps. Reads 8-bit RGB as Fluorspar writes it. Needs Python only.
"""

import struct
import sys
import zlib


def read_rgb(path):
    data = open(path, "rb").read()
    at, packed, width, height = 8, b"", 0, 0
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", content[:10])
            if (depth, color) != (8, 2):
                sys.exit(f"{path}: not 8-bit RGB")
        elif kind == b"IDAT":
            packed += content
    raw, row_length = zlib.decompress(packed), 3 * width
    rows, above = [], bytearray(row_length)
    for y in range(height):
        kind = raw[y * (row_length + 1)]
        row = bytearray(raw[y * (row_length + 1) + 1 : (y + 1) * (row_length + 1)])
        for x in range(row_length):
            left = row[x - 3] if x >= 3 else 0
            up, corner = above[x], above[x - 3] if x >= 3 else 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = up
            elif kind == 3:
                guess = (left + up) // 2
            elif kind == 4:
                estimate = left + up - corner
                guess = min((left, up, corner), key=lambda value: abs(estimate - value))
            else:
                guess = 0
            row[x] = (row[x] + guess) & 255
        rows.append(row)
        above = row
    return width, height, rows


def half(width, height, rows):
    def means(above, below):
        sums = [a + b for a, b in zip(above, below)]
        return bytearray(
            (sums[6 * x + c] + sums[6 * x + 3 + c] + 2) // 4 for x in range(width // 2) for c in range(3)
        )

    return width // 2, height // 2, [means(rows[2 * y], rows[2 * y + 1]) for y in range(height // 2)]


def main():
    path, steps = sys.argv[1], int(sys.argv[2])
    width, height, rows = read_rgb(path)
    if "--half" in sys.argv:
        width, height, rows = half(width, height, rows)
    level = [round(round(value * (steps - 1) / 255) * 255 / (steps - 1)) for value in range(256)]
    raw = b"".join(b"\0" + bytes(level[value] for value in row) for row in rows)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)))
        file.write(chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b""))


main()
