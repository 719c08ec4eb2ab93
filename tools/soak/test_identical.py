"""identical.py: headers and keys may differ, data may not."""

import pathlib
import struct
import tempfile
import unittest

import identical


def text(words):
    return struct.pack("<I", len(words)) + words


def vdb(key, tree):
    """A file of one grid as docs/formats/volume.md describes it."""
    head = struct.pack("<QIII", 0x56444220, 224, 6, 2) + b"\1" + b"u" * 36
    head += struct.pack("<I", 1) + text(b"meniscus_key") + text(b"string") + text(key) + struct.pack("<i", 1)
    head += text(b"density") + text(b"Tree_float_5_4_3") + text(b"")
    body = struct.pack("<II", 6, 1) + text(b"class") + text(b"string") + text(b"fog volume") + tree
    return head + struct.pack("<3q", len(head) + 24, 0, len(head) + 24 + len(body)) + body


class Data(unittest.TestCase):
    def hashes(self, name, *contents):
        """How many different hashes files of these contents have."""
        found = set()
        for content in contents:
            with tempfile.TemporaryDirectory() as folder:
                shot = pathlib.Path(folder) / "shot"
                (shot / "mesh").mkdir(parents=True)
                (shot / "mesh" / name).write_bytes(content)
                ((pattern, files),) = identical.hashed([shot]).items()
                self.assertEqual((pattern, list(files)), ("shot/mesh/a_#" + pathlib.Path(name).suffix, ["0001"]))
                found.update(files.values())
        return len(found)

    def test_comments_keys_and_metadata_are_no_data(self):
        ply = b"ply\ncomment key %s\nelement vertex %d\nend_header\n%s"
        self.assertEqual(self.hashes("a_0001.ply", ply % (b"1", 1, b"x"), ply % (b"2", 1, b"x")), 1)
        self.assertEqual(self.hashes("a_0001.obj", b"# key 1\nv 1 2 3\n", b"# key 23\nv 1 2 3\n"), 1)
        self.assertEqual(self.hashes("a_0001.vdb", vdb(b"1", b"tree"), vdb(b"23", b"tree")), 1)

    def test_elements_and_bodies_are(self):
        ply = b"ply\ncomment key %s\nelement vertex %d\nend_header\n%s"
        self.assertEqual(self.hashes("a_0001.ply", ply % (b"1", 1, b"x"), ply % (b"1", 1, b"y"), ply % (b"1", 2, b"x")), 3)
        self.assertEqual(self.hashes("a_0001.obj", b"v 1 2 3\n", b"v 1 2 4\n"), 2)
        self.assertEqual(self.hashes("a_0001.vdb", vdb(b"1", b"tree"), vdb(b"1", b"free")), 2)
        self.assertEqual(self.hashes("a_0001.pc2", b"1", b"2"), 2)

    def test_differences_name_the_first_frame(self):
        recorded = {"shot/cache/frame_#.mcf": {"0001": "a", "0002": "b", "0003": "c"}, "shot/sheet/a.pc2": {"": "d"}}
        self.assertEqual(identical.differences(recorded, recorded), [])
        found = {"shot/cache/frame_#.mcf": {"0001": "a", "0002": "x"}}
        self.assertEqual(
            identical.differences(recorded, found),
            ["shot/cache/frame_#.mcf: 1 differ, first 0002, 1 missing, first 0003", "shot/sheet/a.pc2: not written"],
        )


if __name__ == "__main__":
    unittest.main()
