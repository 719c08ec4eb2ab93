"""Tests the reader on frames that the tool wrote, and compares them with the tool's own report.

    MENISCUS=target/release/meniscus MENISCUS_SHOT=dam-break python -m unittest discover -s tools/python/tests

MENISCUS is the path of the binary, MENISCUS_SHOT a shot folder with cached frames. MENISCUS_CACHE=frame_0001.mcf
alone reads one frame and leaves the comparison with the binary out. With none of them every test is skipped.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy

import meniscus_fx
from meniscus_fx import cache as meniscus_cache

MENISCUS = os.environ.get("MENISCUS")
SHOT = os.environ.get("MENISCUS_SHOT")


def frames():
    """The frames to read."""
    if SHOT:
        return sorted((pathlib.Path(SHOT) / "cache").glob("frame_*.mcf"))
    path = os.environ.get("MENISCUS_CACHE")
    return [pathlib.Path(path)] if path else []


FRAMES = frames()


class Given(unittest.TestCase):
    @unittest.skipUnless(SHOT, "MENISCUS_SHOT names no shot folder")
    def test_the_shot_has_frames(self):
        self.assertTrue(FRAMES, f"no frame in {SHOT}/cache")


@unittest.skipUnless(FRAMES, "neither MENISCUS_SHOT nor MENISCUS_CACHE names a frame")
class Reader(unittest.TestCase):
    def setUp(self):
        # The last frame, since its chunks are irregular.
        self.path = FRAMES[-1]
        self.data = self.path.read_bytes()
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def read_bytes(self, data):
        path = pathlib.Path(self.folder.name) / "other.mcf"
        path.write_bytes(data)
        return meniscus_cache.read(path)

    def test_columns_have_the_length_of_their_stream(self):
        for path in FRAMES:
            frame = meniscus_cache.read(path)
            self.assertTrue(frame["streams"])
            for stream in frame["streams"].values():
                for values in stream["channels"].values():
                    self.assertEqual(len(values), stream["len"])
                position = stream["channels"].get("position")
                if position is not None:
                    self.assertEqual((position.dtype, position.shape[1:]), (numpy.float32, (3,)))
                    self.assertTrue(numpy.isfinite(position).all())
                ids = stream["channels"].get("id")
                if ids is not None:
                    self.assertEqual(len(numpy.unique(ids)), len(ids))

    def test_the_header_alone_has_the_same_fields(self):
        for path in FRAMES:
            frame, header = meniscus_cache.read(path), meniscus_cache.read_header(path)
            for field in ["key", "frame", "time", "tool"]:
                self.assertEqual(frame[field], header[field])
            self.assertEqual(
                {name: stream["len"] for name, stream in frame["streams"].items()},
                {name: stream["len"] for name, stream in header["streams"].items()},
            )

    def test_a_cut_or_lengthened_file_is_refused(self):
        for data in [b"", self.data[:7], self.data[:40], self.data[:-1], self.data + b"\0", self.data[:-24]]:
            with self.assertRaises(meniscus_cache.CacheError):
                self.read_bytes(data)

    def test_another_version_is_refused(self):
        with self.assertRaisesRegex(meniscus_cache.CacheError, "version 3"):
            self.read_bytes(self.data[:8] + b"\3\0\0\0" + self.data[12:])

    @unittest.skipUnless(meniscus_cache.xxhash, "xxhash is not installed")
    def test_a_flipped_byte_is_refused(self):
        step = max(1, len(self.data) // 100)
        trailer = range(len(self.data) - 24, len(self.data))
        for at in [*range(0, len(self.data), step), *trailer]:
            bad = bytearray(self.data)
            bad[at] ^= 0x10
            with self.assertRaises(meniscus_cache.CacheError, msg=f"byte {at}"):
                self.read_bytes(bytes(bad))


@unittest.skipUnless(MENISCUS and SHOT, "MENISCUS and MENISCUS_SHOT do not name a binary and a shot folder")
class Binary(unittest.TestCase):
    def test_frames_are_as_info_reports(self):
        done = subprocess.run([MENISCUS, "info", SHOT, "--json"], check=True, capture_output=True, text=True)
        info = json.loads(done.stdout)
        self.assertEqual(len(info["frames"]), len(FRAMES))
        for reported, path in zip(info["frames"], FRAMES):
            frame = meniscus_cache.read(path)
            streams = frame["streams"].values()
            self.assertEqual((reported["frame"], reported["time"]), (frame["frame"], frame["time"]))
            self.assertEqual(reported["bytes"], path.stat().st_size)
            for channel in ["position", "velocity"]:
                self.assertEqual(reported["particles"], sum(len(stream["channels"][channel]) for stream in streams))
            scalars = {name: value for stream in streams for name, value in stream["scalars"].items()}
            for name in ["density_dev_avg", "density_dev_max", "compression_avg", "dilation_avg", "volume_change"]:
                self.assertEqual(reported.get(name), scalars.get(name))


class Alone(unittest.TestCase):
    def test_its_error_is_one_of_the_package(self):
        self.assertTrue(issubclass(meniscus_cache.CacheError, meniscus_fx.MeniscusError))

    def test_the_file_works_without_the_package(self):
        script = "import runpy, sys; print(issubclass(runpy.run_path(sys.argv[1])['CacheError'], Exception))"
        found = subprocess.check_output([sys.executable, "-c", script, meniscus_cache.__file__], text=True)
        self.assertEqual(found, "True\n")



if __name__ == "__main__":
    unittest.main()
