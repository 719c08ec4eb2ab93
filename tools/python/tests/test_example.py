# SPDX-License-Identifier: MIT OR Apache-2.0
"""Runs the example and the blocks of docs/python.md and README.md as their readers do: in order, in an empty folder."""

import contextlib
import io
import os
import pathlib
import re
import tempfile
import unittest

from meniscus_fx import _native

TOOLS = pathlib.Path(__file__).resolve().parents[1]


def cells_of(page):
    """The blocks of Python of a page of the repository."""
    return re.findall(r"(?ms)^```python\n(.*?)^```", (TOOLS.parents[1] / page).read_text(encoding="utf-8"))


@unittest.skipUnless(_native.PATH.is_file(), "a checkout has no library: install the wheel (docs/python.md)")
class Example(unittest.TestCase):
    def setUp(self):
        folder, here = tempfile.TemporaryDirectory(), os.getcwd()
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, here)
        os.chdir(folder.name)

    def run_cells(self, cells, name):
        printed, names = io.StringIO(), {"__name__": "__main__"}
        with contextlib.redirect_stdout(printed):
            for number, cell in enumerate(cells, 1):
                exec(compile(cell, f"{name}, cell {number}", "exec"), names)
        return printed.getvalue()

    def test_the_notebook_runs(self):
        cells = re.split(r"(?m)^# %%.*$", (TOOLS / "example.py").read_text(encoding="utf-8"))
        printed = self.run_cells(cells, "example.py")
        self.assertGreater(len(cells), 4)
        self.assertIn("simulate 100 %", printed)
        self.assertTrue(pathlib.Path("drop.ply").stat().st_size > 10_000 and pathlib.Path("wave/cache").is_dir())

    def test_the_guide_runs(self):
        cells = cells_of("docs/python.md")
        self.assertGreater(len(cells), 2)
        self.run_cells(cells, "docs/python.md")

    def test_the_readme_runs_on_the_positions_of_the_guide(self):
        cells = cells_of("README.md")
        self.assertEqual(len(cells), 1)
        self.run_cells(cells_of("docs/python.md")[:1] + cells + ["assert mesh.normals.shape == mesh.vertices.shape"], "README.md")


if __name__ == "__main__":
    unittest.main()
