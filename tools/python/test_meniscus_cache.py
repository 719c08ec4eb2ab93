"""Tests the reader on a frame that the tool wrote.

    MENISCUS_CACHE=cache/frame_0001.mcf python -m unittest discover tools/python

With MENISCUS_INFO set to a file that holds `meniscus info --json` of that frame, its header is compared too.
"""

import json
import os
import pathlib
import tempfile
import unittest

import numpy

import meniscus_cache

PATH = os.environ.get("MENISCUS_CACHE")


@unittest.skipUnless(PATH, "MENISCUS_CACHE names no frame")
class Reader(unittest.TestCase):
    def setUp(self):
        self.data = pathlib.Path(PATH).read_bytes()
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def read_bytes(self, data):
        path = pathlib.Path(self.folder.name) / "other.mcf"
        path.write_bytes(data)
        return meniscus_cache.read(path)

    def test_columns_have_the_length_of_their_stream(self):
        frame = meniscus_cache.read(PATH)
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

    def test_the_header_alone_says_the_same(self):
        frame, header = meniscus_cache.read(PATH), meniscus_cache.read_header(PATH)
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
        with self.assertRaisesRegex(meniscus_cache.CacheError, "version 2"):
            self.read_bytes(self.data[:8] + b"\2\0\0\0" + self.data[12:])

    @unittest.skipUnless(meniscus_cache.xxhash, "xxhash is not installed")
    def test_a_flipped_byte_is_refused(self):
        step = max(1, len(self.data) // 100)
        trailer = range(len(self.data) - 24, len(self.data))
        for at in [*range(0, len(self.data), step), *trailer]:
            bad = bytearray(self.data)
            bad[at] ^= 0x10
            with self.assertRaises(meniscus_cache.CacheError, msg=f"byte {at}"):
                self.read_bytes(bytes(bad))

    @unittest.skipUnless("MENISCUS_INFO" in os.environ, "MENISCUS_INFO names no file")
    def test_the_header_is_what_info_says(self):
        info = json.loads(pathlib.Path(os.environ["MENISCUS_INFO"]).read_text())
        frame = meniscus_cache.read_header(PATH)
        self.assertEqual(info["key"], f"{frame['key']:016x}")
        self.assertEqual((info["index"], info["time"], info["tool"]), (frame["frame"], frame["time"], frame["tool"]))
        self.assertEqual(info["bytes"], len(self.data))
        self.assertEqual(
            [(stream["name"], stream["len"]) for stream in info["streams"]],
            [(name, stream["len"]) for name, stream in frame["streams"].items()],
        )


if __name__ == "__main__":
    unittest.main()
