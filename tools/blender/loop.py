# SPDX-License-Identifier: MIT OR Apache-2.0
"""Makes a loop, an animated WebP, of pictures that render.py has rendered.

    python tools/blender/loop.py pictures/*.png -o loop.webp [--width 480] [--fps 24] [--bytes 1000000]

The interpreter needs Pillow. The quality is the highest with which the file keeps to --bytes.
"""

import argparse
import io
import sys
from pathlib import Path

from PIL import Image

# Qualities of WebP that are tried, in halves of what is left.
QUALITIES = range(1, 96)


def encoded(pictures: list[Image.Image], fps: float, quality: int) -> bytes:
    """The loop as bytes."""
    held = io.BytesIO()
    # Milliseconds, whose sum keeps to the clock.
    ends = [round(i * 1000 / fps) for i in range(len(pictures) + 1)]
    durations = [end - start for start, end in zip(ends, ends[1:])]
    rest = {"save_all": True, "append_images": pictures[1:], "duration": durations, "loop": 0}
    pictures[0].save(held, "WEBP", quality=quality, method=6, **rest)
    return held.getvalue()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pictures", nargs="+", type=Path)
    parser.add_argument("-o", "--output", required=True, type=Path, help="WebP to write")
    parser.add_argument("--width", type=int, default=480, help="in pixels; the shape stays")
    parser.add_argument("--fps", type=float, default=24.0)
    parser.add_argument("--bytes", type=int, default=1_000_000, help="largest file")
    given = parser.parse_args()
    if not (given.fps > 0 and given.width >= 4):
        parser.error(f"found --fps {given.fps} and --width {given.width}, expected more than 0 and at least 4")
    pictures = []
    for path in given.pictures:
        with Image.open(path) as picture:
            height = round(given.width * picture.height / picture.width)
            if pictures and pictures[0].height != height:
                parser.error(f"{path}: found another shape than that of {given.pictures[0]}, expected one size")
            pictures.append(picture.convert("RGB").resize((given.width, height), Image.Resampling.LANCZOS))
    best, low, high = None, QUALITIES[0], QUALITIES[-1]
    while low <= high:
        middle = (low + high) // 2
        tried = encoded(pictures, given.fps, middle)
        if len(tried) <= given.bytes:
            best, low = (tried, middle), middle + 1
        else:
            high = middle - 1
    if best is None:
        print(f"{given.output}: more than {given.bytes} bytes at the lowest quality; fewer pictures or a smaller --width help", file=sys.stderr)
        return 1
    given.output.write_bytes(best[0])
    print(f"{given.output}: {len(pictures)} pictures, {len(best[0])} bytes, quality {best[1]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
