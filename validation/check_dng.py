#!/usr/bin/env python3
"""Check that another raw reader finds in a DNG what Fluorspar wrote.

    fluorspar run oraleye-2021 --spp 1 --out run
    fluorspar capture run/components.exr --format dng --out dng
    fluorspar capture run/components.exr --format tiff --out tiff
    check_dng.py dng tiff

For every raw_NAME.dng in the first folder: pixels, mosaic, black and white level as rawpy (LibRaw) reads them must be
those of raw_NAME.tiff with its description in the second. Then LibRaw develops the frame, which must give a picture that
is neither black nor flat. Ends with 1 at the first difference.

Needs numpy and rawpy.
"""

import json
import struct
import sys
from pathlib import Path

import numpy as np
import rawpy


def strips_of_tiff(path):
    """Pixels of our 16-bit gray TIFF: little-endian, uncompressed strips."""
    data = path.read_bytes()
    assert data[:4] == b"II*\0", path
    start = struct.unpack_from("<I", data, 4)[0]
    tags = {}
    for row in range(struct.unpack_from("<H", data, start)[0]):
        tag, kind, count = struct.unpack_from("<HHI", data, start + 2 + 12 * row)
        at = start + 10 + 12 * row
        size = {3: 2, 4: 4}.get(kind)
        if size is None:
            continue
        if size * count > 4:
            at = struct.unpack_from("<I", data, at)[0]
        tags[tag] = struct.unpack_from("<" + {3: "H", 4: "I"}[kind] * count, data, at)
    pixels = b"".join(data[o : o + n] for o, n in zip(tags[273], tags[279]))
    return np.frombuffer(pixels, "<u2").reshape(tags[257][0], tags[256][0])


def check(dng, tiff):
    info = json.loads(Path(str(tiff) + ".json").read_text())
    expected = strips_of_tiff(tiff)
    with rawpy.imread(str(dng)) as raw:
        pixels = raw.raw_image
        assert pixels.shape == expected.shape, (pixels.shape, expected.shape)
        assert np.array_equal(pixels, expected), f"{np.count_nonzero(pixels != expected)} pixels differ"
        assert raw.white_level == info["white_level"], (raw.white_level, info["white_level"])
        black = raw.black_level_per_channel
        assert all(abs(b - info["black_level"]) <= 0.5 for b in black), (black, info["black_level"])
        mosaic = info["mosaic"]
        if mosaic["channels"] != ["mono"]:
            names = np.array(list(raw.color_desc.decode()))[raw.raw_colors[: mosaic["rows"], : mosaic["cols"]]]
            cell = [mosaic["channels"][c] for c in mosaic["pattern"]]
            assert list(names.ravel()) == cell, (names, cell)
            picture = raw.postprocess(use_camera_wb=True, no_auto_bright=False, output_bps=8)
            assert picture.shape[:2] == expected.shape and picture.max() > picture.min(), "nothing was developed"
        neutral = 1 / np.array(raw.camera_whitebalance[:3]) if mosaic["channels"] != ["mono"] else None
    print(f"{dng.name}: {expected.shape[1]} x {expected.shape[0]}, black {black}, white {info['white_level']}, neutral {neutral}")


def main():
    folders = [Path(a) for a in sys.argv[1:]]
    if len(folders) != 2:
        sys.exit(__doc__)
    files = sorted(folders[0].glob("raw_*.dng"))
    if not files:
        sys.exit(f"{folders[0]}: no raw_*.dng here")
    for dng in files:
        try:
            check(dng, folders[1] / (dng.stem + ".tiff"))
        except AssertionError as error:
            sys.exit(f"{dng}: {error}")


if __name__ == "__main__":
    main()
