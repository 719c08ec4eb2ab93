# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests the program of the installed package and its jobs as processes (docs/python.md)."""

import json
import os
import pathlib
import pickle
import subprocess
import sys
import sysconfig
import tempfile
import unittest

import meniscus_fx as mf
from meniscus_fx import _program

PROGRAM = pathlib.Path(_program.__file__).parent / "bin" / ("meniscus.exe" if os.name == "nt" else "meniscus")
SMALL = """title = "Small"
frames = "1-4"
[[world.collider]]
shape = { tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] } }
[liquid]
spacing = 0.1
iterations = 6
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = [0.8, 0.8, 0.8] } }
[output]
mesh = ["ply"]
"""


@unittest.skipUnless(PROGRAM.is_file(), "a checkout has no program: install the wheel (docs/python.md)")
class Program(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.preset = self.folder / "small.toml"
        self.preset.write_text(SMALL)

    @unittest.skipIf(os.name == "nt", "Windows has no permission to execute")
    def test_the_program_can_be_run_after_it_lost_its_permission(self):
        mode = PROGRAM.stat().st_mode
        try:
            PROGRAM.chmod(0o644)
            self.assertTrue(os.access(mf.program(), os.X_OK))
        finally:
            PROGRAM.chmod(mode)

    def test_program_command_and_package_have_one_version(self):
        expected = f"meniscus {mf.__version__}\n"
        self.assertEqual(subprocess.check_output([mf.program(), "--version"], text=True), expected)
        self.assertEqual(subprocess.check_output([sys.executable, "-m", "meniscus_fx", "--version"], text=True), expected)
        command = pathlib.Path(sysconfig.get_path("scripts")) / PROGRAM.name
        if command.exists():
            self.assertEqual(subprocess.check_output([command, "--version"], text=True), expected)

    def test_the_command_has_the_exit_code_of_the_program(self):
        done = subprocess.run([sys.executable, "-m", "meniscus_fx", "info", str(self.folder / "nowhere")], capture_output=True)
        self.assertEqual(done.returncode, 10, done.stderr)

    def test_a_simulation_reports_progress_and_fills_a_cache(self):
        reports = []
        shot = mf.simulate(self.preset, self.folder / "wave", progress=reports.append)
        self.assertEqual([path.name for path in shot.frames], [f"frame_000{frame}.mcf" for frame in range(1, 5)])
        self.assertEqual(shot.manifest["title"], "Small")
        self.assertEqual((reports[-1].job, reports[-1].percent), ("simulate", 100.0))
        percents = [report.percent for report in reports]
        self.assertEqual(percents, sorted(percents))
        self.assertIn("frame 0004", reports[-1].text)
        self.assertRegex(str(reports[-1]), r"^simulate 100 %  frame 0004")
        self.assertEqual(shot.meshes, [])
        position = mf.cache.read(shot.frames[-1])["streams"]["liquid"]["channels"]["position"]
        self.assertEqual(position.shape, (512, 3))

    def test_a_shot_has_its_outputs(self):
        shot = mf.shot(self.preset, self.folder / "wave", frames="1-2", threads=1, settings={"surface.voxel": 1, "liquid.xsph": "none"})
        self.assertEqual([path.suffix for path in shot.meshes], [".ply", ".ply"])

    def test_the_folder_is_named_as_the_program_names_it(self):
        here = os.getcwd()
        os.chdir(self.folder)
        try:
            self.assertEqual(mf.simulate("small.toml", frames="1").folder, pathlib.Path("small"))
            tier = mf.simulate("dam-break", quality="draft", frames="1")
            self.assertTrue(tier.frames and tier.folder == pathlib.Path("dam-break-draft"))
            for words in (["small.toml"], ["dam-break", "--quality", "draft"]):
                # The program finds the frames of the same folder.
                self.assertIn("1 up to date", mf.run("simulate", *words, "--frames=1"))
        finally:
            os.chdir(here)

    def test_mistakes_are_exceptions_with_their_place(self):
        with self.assertRaises(mf.ProgramError) as raised:
            mf.simulate(self.preset, self.folder / "wave", settings={"liquid.cfl": 99})
        error = raised.exception
        self.assertEqual((error.code, error.problems[0]["key"]), (2, "liquid.cfl"))
        self.assertRegex(str(error), r"--set:1:12: `liquid\.cfl` is out of range: found 99")
        self.assertEqual(pickle.loads(pickle.dumps(error)).problems, error.problems)
        with self.assertRaisesRegex(mf.ProgramError, "built-in preset is called `nope`(.|\n)*dam-break"):
            mf.simulate("nope", self.folder / "wave")
        with self.assertRaisesRegex(mf.ProgramError, "unexpected argument"):
            mf.run("mesh", "--nope")
        with self.assertRaisesRegex(mf.ParameterError, r"settings\['liquid.cfl'\]: found a dict"):
            mf.simulate(self.preset, self.folder / "wave", settings={"liquid.cfl": {}})
        with self.assertRaises(mf.ParameterError):
            mf.simulate("nul\0", self.folder / "wave")
        # A preset whose name looks like a flag is a preset.
        with self.assertRaisesRegex(mf.ProgramError, "is called `--help`"):
            mf.simulate("--help", self.folder / "wave")

    def test_an_exception_of_the_callback_stops_the_job(self):
        def stop(progress):
            if "frame 0002" in progress.text:
                raise RuntimeError("enough")

        with self.assertRaisesRegex(RuntimeError, "enough"):
            mf.simulate("dam-break", self.folder / "wave", quality="draft", progress=stop)
        shot = mf.Shot(self.folder / "wave")
        count = len(shot.frames)
        self.assertTrue(1 <= count < 40, count)
        self.assertEqual(len(mf.simulate("dam-break", shot.folder, quality="draft", frames=f"1-{count}").frames), count)

    def test_ctrl_c_is_a_keyboard_interrupt(self):
        script = f"""
import os, signal, meniscus_fx as mf
def stop(progress):
    if "frame 0002" in progress.text:
        os.kill(os.getpid(), signal.SIGINT)
try:
    mf.simulate("dam-break", {str(self.folder / "wave")!r}, quality="draft", progress=stop)
except KeyboardInterrupt:
    print("interrupted")
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
        self.assertEqual((done.stdout, done.returncode), ("interrupted\n", 0), done.stderr)

    def test_a_result_longer_than_a_pipe_arrives_whole(self):
        result = mf.run("presets", "show", "dam-break")
        self.assertIn("[liquid]", result)
        # A pipe holds 64 KiB.
        schema = [mf.run("presets", "show", name.split()[0]) for name in mf.run("presets", "list").splitlines()[:2]]
        self.assertEqual(len(schema), 2)
        shot = mf.simulate(self.preset, self.folder / "long", frames="1-300", settings={"liquid.iterations": 1})
        text = mf.run("info", shot.folder, "--json")
        self.assertGreater(len(text), 1 << 16)
        self.assertEqual(len(json.loads(text)["frames"]), 300)


if __name__ == "__main__":
    unittest.main()
