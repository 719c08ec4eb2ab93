# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests the program of the installed package and its jobs as processes (docs/python.md)."""

import json
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
import unittest
import unittest.mock

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


# A shell that runs the tests in the background ignores Ctrl-C in them, and in all that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)


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
        with self.assertRaisesRegex(mf.ParameterError, r"liquid.cfl: found a object, expected a number"):
            mf.simulate(self.preset, self.folder / "wave", settings={"liquid.cfl": object()})
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

    def test_settings_are_those_of_surfaces(self):
        import numpy

        settings = {"surface.voxel": numpy.float32(0.5), "surface.smoothing": {"wavelength": 4, "skin": None}, "liquid.xsph": None}
        mf.simulate(self.preset, self.folder / "wave", frames="1", settings=settings)
        with self.assertRaisesRegex(mf.ProgramError, "gravity(.|\n)*3"):
            mf.simulate(self.preset, self.folder / "wave", frames="1", settings={"world.gravity": numpy.zeros(2)})

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


# Counts signals for a while after the first, as a program that finishes its frame.
FAKE = """#!{python}
import os, signal, sys, time
count = 0
def interrupt(*_):
    global count
    count += 1
signal.signal(signal.SIGINT, interrupt)
with open({notes!r}, "a") as file:
    file.write(f"{{os.getpid()}} started\\n")
try:
    print('{{"event": "progress", "data": {{"job": "simulate", "percent": 1}}}}', file=sys.stderr, flush=True)
except BrokenPipeError:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
end = time.monotonic() + {seconds}
while time.monotonic() < end and not count:
    time.sleep(0.02)
if count:
    # A signal interrupts no sleep.
    time.sleep(1.5)
with open({notes!r}, "a") as file:
    file.write(f"{{os.getpid()}} {{count}}\\n")
sys.exit({code} if {code} or not count else 130)
"""


@unittest.skipIf(os.name == "nt", "the program of these tests is a script")
class Signals(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.notes = self.folder / "notes"

    def fake(self, seconds=60, code=0):
        """Puts a script in the place of the program."""
        path = self.folder / "program"
        path.write_text(FAKE.format(python=sys.executable, seconds=seconds, code=code, notes=str(self.notes)))
        path.chmod(0o755)
        patch = unittest.mock.patch.object(_program, "program", lambda: path)
        patch.start()
        self.addCleanup(patch.stop)
        return path

    def test_ctrl_c_of_a_terminal_reaches_the_program_once(self):
        script = f"""
import pathlib, meniscus_fx as mf
from meniscus_fx import _program
_program.program = lambda: pathlib.Path({str(self.fake())!r})
try:
    mf.run("x", progress=lambda _: print("started", flush=True))
except KeyboardInterrupt:
    print("interrupted")
"""
        with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
            self.assertEqual(process.stdout.readline(), "started\n")
            os.killpg(process.pid, signal.SIGINT)
            self.assertEqual(process.communicate(timeout=60)[0], "interrupted\n")
        self.assertEqual(self.notes.read_text().split()[-1], "1")

    def test_a_program_that_something_else_interrupted_has_failed(self):
        self.fake(seconds=0, code=130)
        with self.assertRaisesRegex(mf.ProgramError, "interrupted from outside") as raised:
            mf.run("x")
        self.assertEqual(raised.exception.code, 130)

    def test_an_interrupt_right_after_the_start_ends_the_program(self):
        self.fake(seconds=8)
        started = []

        class Popen(subprocess.Popen):
            def __init__(self, *arguments, **options):
                super().__init__(*arguments, **options)
                started.append(self)

        def interrupt(thread):
            while not self.notes.exists():
                time.sleep(0.02)
            raise RuntimeError("interrupted")

        real = threading.Thread.start
        with unittest.mock.patch.object(subprocess, "Popen", Popen):
            # Of the first thread, which reads; later ones end the program.
            with unittest.mock.patch.object(threading.Thread, "start", lambda thread: (interrupt if thread._target else real)(thread)):
                with self.assertRaisesRegex(RuntimeError, "interrupted"):
                    mf.run("x")
        self.assertIsNotNone(started[0].poll())
        self.assertEqual(self.notes.read_text().split()[1:], ["started", str(started[0].pid), "1"])

    def test_a_program_that_cannot_be_started_is_reported(self):
        self.fake().write_bytes(b"\x7fELF")
        with self.assertRaisesRegex(mf.MeniscusError, "the program cannot be started: .*install meniscus-fx again"):
            mf.run("x")


if __name__ == "__main__":
    unittest.main()
