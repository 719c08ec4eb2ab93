# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests surfaces of arrays: `reconstruct` of the installed package (docs/python.md)."""

import _thread
import concurrent.futures
import ctypes
import gc
import multiprocessing
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import types
import unittest
import warnings
import weakref

import numpy

import meniscus_fx as mf
from meniscus_fx import _mesh, _native

IS_INSTALLED = _native.PATH.is_file()
SPACING = 0.05


# Start of a script that changes how much memory it may take [bytes].
LIMITED = """
import resource
import numpy
import meniscus_fx as mf
from meniscus_fx import _mesh
def used():
    return int(open("/proc/self/statm").read().split()[0]) << 12
def resident():
    return int(open("/proc/self/statm").read().split()[1]) << 12
def limit(bytes):
    resource.setrlimit(resource.RLIMIT_AS, (bytes, resource.RLIM_INFINITY))
"""


# A shell that runs the tests in the background ignores Ctrl-C in them, and in all that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)


def block(n=8, spacing=SPACING):
    """n³ particles as float32, slightly out of order."""
    grid = numpy.stack(numpy.meshgrid(*[numpy.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shift = numpy.random.default_rng(1).uniform(-0.1, 0.1, grid.shape)
    return ((grid + shift) * spacing).astype(numpy.float32)


def volume_of_a_block(positions):
    return len(mf.reconstruct(positions, SPACING).vertices)


def write_a_block(positions, path):
    mf.reconstruct(positions, SPACING).write(path)


def same(a, b):
    return numpy.array_equal(a.vertices, b.vertices) and numpy.array_equal(a.triangles, b.triangles)


@unittest.skipUnless(IS_INSTALLED, "a checkout has no library: install the wheel (docs/python.md)")
class Reconstruct(unittest.TestCase):
    def setUp(self):
        self.positions = block()
        self.mesh = mf.reconstruct(self.positions, SPACING)

    def test_a_block_is_a_sound_mesh_of_its_volume(self):
        expected = len(self.positions) * SPACING**3
        self.assertTrue(self.mesh.is_sound)
        self.assertEqual(self.mesh.report["check"]["components"], 1)
        self.assertLess(abs(self.mesh.volume / expected - 1), 0.15)
        self.assertGreater(self.mesh.area, 6 * (7 * SPACING) ** 2 * 0.9)
        self.assertTrue(numpy.allclose(numpy.linalg.norm(self.mesh.normals, axis=1), 1, atol=1e-3))
        self.assertEqual(self.mesh.vertices.dtype, numpy.float32)
        self.assertEqual(self.mesh.triangles.dtype, numpy.uint32)
        self.assertLess(self.mesh.triangles.max(), len(self.mesh.vertices))
        # The divergence theorem by the arrays alone: faces are counter-clockwise seen from outside.
        a, b, c = self.mesh.vertices.astype(float)[self.mesh.triangles].transpose(1, 0, 2)
        volume = (a * numpy.cross(b, c)).sum() / 6
        self.assertAlmostEqual(volume, self.mesh.volume, places=6)
        self.assertGreater(volume, 0)

    def test_suitable_arrays_are_not_copied(self):
        self.assertIs(_mesh._column("positions", self.positions, vectors=True), self.positions)
        ids = numpy.arange(4, dtype=numpy.uint32)
        self.assertIs(_mesh._column("id", ids, vectors=None), ids)
        read_only = self.positions.copy()
        read_only.flags.writeable = False
        self.assertIs(_mesh._column("positions", read_only, vectors=True), read_only)
        self.assertTrue(same(mf.reconstruct(read_only, SPACING), self.mesh))
        for array in (self.mesh.vertices, self.mesh.triangles, self.mesh.normals):
            self.assertFalse(array.flags.owndata)

    def test_other_arrays_are_converted(self):
        wide = numpy.zeros((len(self.positions), 6), numpy.float32)
        wide[:, ::2] = self.positions
        raw = b"x" + self.positions.tobytes()
        unaligned = numpy.frombuffer(raw, numpy.uint8)[1:].view(numpy.float32).reshape(-1, 3)
        others = {
            "float64": self.positions.astype(float),
            "big-endian": self.positions.astype(">f4"),
            "Fortran": numpy.asfortranarray(self.positions),
            "strided": wide[:, ::2],
            "unaligned": unaligned,
            "list": self.positions.tolist(),
        }
        for name, positions in others.items():
            with self.subTest(name):
                self.assertTrue(same(mf.reconstruct(positions, SPACING), self.mesh))
        self.assertFalse(unaligned.flags.aligned)

    def test_arrays_outlive_the_mesh(self):
        vertices, expected = self.mesh.vertices, self.mesh.vertices.copy()
        triangles, faces = self.mesh.triangles, self.mesh.triangles.copy()
        self.mesh = None
        gc.collect()
        for _ in range(4):
            mf.reconstruct(self.positions * 0.7, SPACING)
        self.assertTrue(numpy.array_equal(vertices, expected) and numpy.array_equal(triangles, faces))

    def test_wrong_arrays_are_refused_with_their_place(self):
        bad = self.positions.copy()
        bad[[17, 40], 1] = numpy.nan, numpy.inf
        few = self.positions[:-1]
        cases = [
            (r"positions: entry 17 .*2 such entries", bad, {}),
            (r"positions: entry 3 ", numpy.where(numpy.arange(24).reshape(8, 3) == 9, 1e300, 0), {}),
            (r"positions: found the shape \(8, 2\), expected \(n, 3\)", numpy.zeros((8, 2)), {}),
            (r"positions: found the shape \(8,\)", numpy.zeros(8), {}),
            (r"positions: found the shape \(\)", numpy.float32(1), {}),
            (r"positions: found values of type .*U1", numpy.full((2, 3), "x"), {}),
            (r"positions: found values of type complex", numpy.zeros((2, 3), complex), {}),
            (r"velocity: found 511 values, expected 512", self.positions, {"velocity": few}),
            (r"velocity: entry 17 ", self.positions, {"velocity": bad}),
            (r"radius: found the shape \(512, 3\)", self.positions, {"radius": self.positions}),
            (r"attributes\['t'\]: found the shape", self.positions, {"attributes": {"t": numpy.zeros((512, 2))}}),
            (r"attributes\['t'\]: found -1 to -1", self.positions, {"attributes": {"t": numpy.full(512, -1)}}),
        ]
        for message, positions, more in cases:
            with self.subTest(message), self.assertRaisesRegex(mf.ParticleError, message):
                mf.reconstruct(positions, SPACING, **more)
        with self.assertRaisesRegex(mf.ParameterError, "expected a name other than position"):
            mf.reconstruct(self.positions, SPACING, attributes={"position": few})

    def test_parameters_out_of_their_range_are_named(self):
        cases = [
            (r"surface\.voxel.*20.*0\.05.*10", {"voxel": 20}),
            (r"surface\.voxel", {"voxel": float("nan")}),
            (r"surface\.kernel_radius", {"kernel_radius": "wide"}),
            (r"did you mean `voxel`", {"voxle": 0.5}),
            (r"surface\.smoothing\.wavelength", {"smoothing": {"wavelength": 1e9}}),
            (r"surface\.contact: found settings", {"contact": {}}),
            (r"quality: found `best`, expected `draft`", {"quality": "best"}),
            (r"quality: found 3", {"quality": 3}),
            (r"threads: found -1, expected an integer from 0 to 1024", {"threads": -1}),
            (r"threads: found 1025", {"threads": 1025}),
            (r"surface\.voxel: found a object", {"voxel": object()}),
        ]
        for message, settings in cases:
            with self.subTest(message), self.assertRaisesRegex(mf.ParameterError, message):
                mf.reconstruct(self.positions, SPACING, **settings)
        for spacing in [0, -1, 1e7, float("nan"), "wide", None]:
            with self.subTest(spacing=spacing), self.assertRaisesRegex(mf.ParameterError, "spacing: found"):
                mf.reconstruct(self.positions, spacing)
        self.assertTrue(issubclass(mf.ParameterError, ValueError) and issubclass(mf.ParticleError, ValueError))

    def test_settings_reach_the_surface(self):
        plain = mf.reconstruct(self.positions, SPACING, quality=None)
        self.assertTrue(same(plain, mf.reconstruct(self.positions, SPACING, anisotropy=None, smoothing=None)))
        fine = mf.reconstruct(self.positions, SPACING, quality=None, voxel=numpy.float32(0.25))
        self.assertGreater(len(fine.triangles), 3 * len(plain.triangles))
        few = mf.reconstruct(self.positions, SPACING, decimation={"fraction": 0.25, "triangles": None})
        self.assertLess(len(few.triangles), 0.3 * len(self.mesh.triangles))
        smoother = mf.reconstruct(self.positions, SPACING, **{"smoothing.wavelength": 8})
        self.assertFalse(same(smoother, self.mesh))

    def test_attributes_arrive_at_the_vertices(self):
        count = len(self.positions)
        velocity = numpy.tile(numpy.float32([1, -2, 3]), (count, 1))
        mesh = mf.reconstruct(
            self.positions,
            SPACING,
            velocity=velocity,
            attributes={"heat": self.positions[:, 0], "source": numpy.full(count, 7)},
        )
        self.assertEqual(set(mesh.attributes), {"velocity", "heat", "source"})
        self.assertTrue(numpy.allclose(mesh.attributes["velocity"], [1, -2, 3], atol=1e-5))
        self.assertEqual(mesh.attributes["source"].dtype, numpy.uint32)
        self.assertTrue((mesh.attributes["source"] == 7).all())
        error = numpy.abs(mesh.attributes["heat"] - mesh.vertices[:, 0])
        self.assertLess(error.max(), 1.5 * SPACING)
        self.assertTrue(same(mesh, self.mesh))

    def test_radii_scale_the_kernels(self):
        drops = numpy.float32([[0, 0, 0], [1, 0, 0]])
        radius = numpy.float32([0.5, 1.0]) * SPACING
        mesh = mf.reconstruct(drops, SPACING, radius=radius, quality=None)
        right = mesh.vertices[:, 0] > 0.5
        extent = [numpy.ptp(mesh.vertices[side], axis=0).mean() for side in (~right, right)]
        self.assertAlmostEqual(extent[1] / extent[0], 2, delta=0.2)

    def test_small_components_become_points(self):
        positions = numpy.concatenate([self.positions, numpy.float32([[2, 0, 0]])])
        mesh = mf.reconstruct(positions, SPACING, components={}, velocity=positions)
        self.assertEqual((mesh.points.shape, mesh.point_radii.shape), ((1, 3), (1,)))
        self.assertTrue(numpy.allclose(mesh.points, [[2, 0, 0]], atol=1e-3))
        self.assertTrue(numpy.allclose(mesh.point_attributes["velocity"], [[2, 0, 0]], atol=1e-3))
        self.assertIsNone(self.mesh.points)

    def test_losses_are_warnings(self):
        crowd = numpy.zeros((2000, 3), numpy.float32)
        with self.assertWarnsRegex(mf.SurfaceWarning, r"^\d+ particles left out of clusters"):
            mf.reconstruct(crowd, SPACING, quality=None)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mf.reconstruct(self.positions, SPACING)

    def test_far_from_the_origin_vertices_are_in_double_precision(self):
        far = self.positions + numpy.float32([8192, 0, 0])
        mesh = mf.reconstruct(far, SPACING)
        self.assertEqual(mesh.vertices.dtype, numpy.float64)
        self.assertGreater(mesh.vertices[:, 0].min(), 8191)
        self.assertTrue(mesh.is_sound)

    def test_no_particles_are_an_empty_mesh(self):
        for nothing in ([], numpy.zeros((0, 3))):
            mesh = mf.reconstruct(nothing, SPACING, velocity=nothing)
            self.assertEqual((mesh.vertices.shape, mesh.triangles.shape, mesh.is_sound), ((0, 3), (0, 3), True))

    def test_threads_and_concurrent_calls_give_the_same_mesh(self):
        for threads in (1, 3):
            self.assertTrue(same(mf.reconstruct(self.positions, SPACING, threads=threads), self.mesh))
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            calls = [pool.submit(mf.reconstruct, self.positions, SPACING) for _ in range(8)]
            self.assertTrue(all(same(call.result(), self.mesh) for call in calls))

    @unittest.skipUnless(hasattr(os, "fork"), "this system does not fork")
    def test_a_forked_process_reconstructs_too(self):
        with multiprocessing.get_context("fork").Pool(1) as pool:
            found = pool.apply_async(volume_of_a_block, [self.positions]).get(timeout=60)
        self.assertEqual(found, len(self.mesh.vertices))

    def test_a_file_has_the_mesh(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "surface.ply"
            self.mesh.write(path)
            header, body = path.read_bytes().split(b"end_header\n", 1)
            self.assertIn(b"element vertex %d\n" % len(self.mesh.vertices), header)
            first = numpy.frombuffer(body, "<f4", 3)
            self.assertTrue(numpy.array_equal(first, self.mesh.vertices[0]))
            self.mesh.write(str(path.with_suffix(".OBJ")))
            with self.assertRaisesRegex(mf.ParameterError, r"found the ending `stl`, expected `\.ply` or `\.obj`"):
                self.mesh.write(path.with_suffix(".stl"))
            with self.assertRaisesRegex(OSError, "nowhere"):
                self.mesh.write(pathlib.Path(folder) / "nowhere" / "surface.ply")
            self.assertEqual(sorted(os.listdir(folder)), ["surface.OBJ", "surface.ply"])

    def test_the_mesh_is_that_of_the_program(self):
        with tempfile.TemporaryDirectory() as folder:
            numpy.save(pathlib.Path(folder) / "particles.npy", self.positions)
            self.mesh.write(pathlib.Path(folder) / "here.ply")
            out = pathlib.Path(folder) / "out"
            mf.run("mesh", pathlib.Path(folder) / "particles.npy", f"--spacing={SPACING}", "-o", out)
            (there,) = out.rglob("*.ply")
            bodies = [path.read_bytes().split(b"end_header\n", 1)[1] for path in (pathlib.Path(folder) / "here.ply", there)]
            self.assertEqual(bodies[0], bodies[1])

    def test_arrays_are_read_only_and_copies_are_not(self):
        mesh = mf.reconstruct(self.positions, SPACING, components={}, velocity=self.positions)
        far = mf.reconstruct(self.positions + numpy.float32([8192, 0, 0]), SPACING)
        for array in (mesh.vertices, mesh.triangles, mesh.normals, mesh.points, mesh.attributes["velocity"], far.vertices):
            with self.assertRaisesRegex(ValueError, "read-only"):
                array[...] = 0
        with self.assertRaises(ValueError):
            self.mesh.vertices.flags.writeable = True
        vertices = self.mesh.vertices.copy()
        vertices += 1
        self.assertTrue(numpy.array_equal(vertices, self.mesh.vertices + numpy.float32(1)))

    def test_a_mesh_can_be_copied_and_not_pickled(self):
        # Memory that two owners free ends the interpreter.
        script = """
import copy, gc, pickle, numpy, meniscus_fx as mf
mesh = mf.reconstruct(numpy.zeros((1, 3)), 0.1)
vertices = mesh.vertices.tolist()
for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
    try:
        pickle.dumps(mesh, protocol)
    except TypeError as error:
        assert "a mesh cannot be pickled" in str(error), error
    else:
        raise SystemExit("pickled")
copies = [copy.copy(mesh), copy.deepcopy(mesh)]
del mesh
for _ in range(2):
    gc.collect()
    assert all(found.vertices.tolist() == vertices for found in copies)
    copies[-1].write("copy.ply")
    copies.pop(0)
    if not copies: break
print("done")
"""
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, timeout=60)
        self.assertEqual((done.stdout, done.returncode), ("done\n", 0), done.stderr)

    def test_attributes_are_checked_as_other_arrays(self):
        bad = self.positions[:, 0].copy()
        bad[9] = numpy.inf
        with self.assertRaisesRegex(mf.ParticleError, r"attributes\['heat'\]: entry 9 is inf"):
            mf.reconstruct(self.positions, SPACING, attributes={"heat": bad})
        for name in ("position", "velocity", "radius", 3):
            with self.subTest(name), self.assertRaisesRegex(mf.ParameterError, "expected a name other than position, velocity and radius"):
                mf.reconstruct(self.positions, SPACING, attributes={name: self.positions})

    @unittest.skipUnless(sys.platform == "linux", "limits of memory are Linux's")
    def test_threads_that_the_system_refuses_are_reported(self):
        script = LIMITED + """
mf.reconstruct(numpy.zeros((1, 3)), 0.1)
limit(used() + (256 << 20))
try:
    mf.reconstruct(numpy.zeros((1, 3)), 0.1, threads=1000)
except mf.OutOfMemoryError as error:
    print(error)
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
        self.assertRegex(done.stdout, "the system refused memory for 1000 threads.*pass fewer", done.stderr)

    @unittest.skipUnless(sys.platform == "linux", "limits of memory are Linux's")
    def test_refused_memory_is_a_memory_error(self):
        script = LIMITED + """
import sys
x = numpy.random.default_rng(0).uniform(0, 1, (20_000, 3)).astype(numpy.float32)
limit(used() + (int(sys.argv[1]) << 20))
try:
    print(len(mf.reconstruct(x, 0.04, voxel=0.25, threads=2).vertices))
except MemoryError as error:
    print("refused", type(error).__name__, error)
except mf.ParameterError as error:
    # A thread needs memory too, and the error of the system does not name what was lacking.
    assert "the system refused to start" in str(error), error
    print("refused", type(error).__name__, error)
limit(resource.RLIM_INFINITY)
assert mf.reconstruct(numpy.zeros((1, 3)), 0.1).is_sound
"""
        outcomes = []
        for megabytes in (24, 80, 112, 192, 512, 4096):
            done = subprocess.run([sys.executable, "-c", script, str(megabytes)], capture_output=True, text=True, timeout=120)
            self.assertEqual(done.returncode, 0, f"{megabytes} MiB: {done.stdout} {done.stderr}")
            outcomes.append(done.stdout)
        refused = [outcome.startswith("refused ") for outcome in outcomes]
        self.assertEqual((refused[0], refused[-1]), (True, False), outcomes)
        # Where there is enough, the mesh is the same.
        self.assertEqual(len({outcome for outcome in outcomes if not outcome.startswith("refused")}), 1, outcomes)
        self.assertTrue(any("the surface needs about" in outcome for outcome in outcomes), outcomes)

    @unittest.skipUnless(sys.platform == "linux", "limits of memory are Linux's")
    def test_memory_that_is_refused_in_the_midst_of_a_call_ends_it(self):
        # 0 MiB: the reserve that is freed then suffices. Below: nothing does, and the call is left, with what it reads.
        script = LIMITED + """
import sys, threading, time, gc
from meniscus_fx import _native
x = numpy.random.default_rng(0).uniform(0, 1, (150_000, 3)).astype(numpy.float32)
def later():
    # By then the estimate was granted, and the work is under way.
    while resident() < before + (80 << 20):
        time.sleep(0.01)
    limit(max(used() + (int(sys.argv[1]) << 20), 1 << 20))
before = resident()
threading.Thread(target=later, daemon=True).start()
try:
    print(mf.reconstruct(x, 0.02, voxel=0.3, threads=2))
except mf.OutOfMemoryError as error:
    print(error)
limit(resource.RLIM_INFINITY)
gc.collect()
print(len(_native._read))
assert mf.reconstruct(numpy.zeros((1, 3)), 0.1).is_sound
"""
        for megabytes, message, left in ((0, "the system refused memory: .*or voxel$", 0), (-100_000, "stays taken until the process ends$", 1)):
            with self.subTest(megabytes):
                command = [sys.executable, "-c", script, str(megabytes)]
                done = subprocess.run(command, capture_output=True, text=True, timeout=120)
                self.assertEqual(done.returncode, 0, done.stderr)
                first, second = done.stdout.splitlines()
                self.assertRegex(first, message)
                self.assertEqual(second, str(left))

    def test_memory_over_the_limit_is_refused_before_the_work(self):
        with self.assertRaisesRegex(MemoryError, r"needs about \d+ MB of memory, of which 2 MB is allowed by max_memory"):
            mf.reconstruct(self.positions, SPACING, max_memory=2_000_000)
        self.assertTrue(same(mf.reconstruct(self.positions, SPACING, max_memory=1 << 30), self.mesh))
        for wrong in (0, -1, 1.5, True, 1 << 64):
            with self.subTest(wrong), self.assertRaisesRegex(mf.ParameterError, "max_memory: found"):
                mf.reconstruct(self.positions, SPACING, max_memory=wrong)

    @unittest.skipUnless(hasattr(os, "fork"), "this system does not fork")
    def test_a_forked_process_writes_too(self):
        with tempfile.TemporaryDirectory() as folder:
            here, there = (pathlib.Path(folder) / name for name in ("here.ply", "there.ply"))
            self.mesh.write(here)
            with multiprocessing.get_context("fork").Pool(1) as pool:
                pool.apply_async(write_a_block, [self.positions, there]).get(timeout=60)
            self.assertEqual(here.read_bytes(), there.read_bytes())

    def test_ctrl_c_stops_a_call(self):
        # The call stops after the pass that runs: density, anisotropy and smoothing take a second each at least.
        script = """
import os, signal, threading
import numpy
import meniscus_fx as mf
from meniscus_fx import _native
flags, statuses = [], []
library, free = _native.library(), _native.Outcome.__del__
class Flag(_native.Flag):
    def set(self):
        flags.append(self.address)
        super().set()
def freed(outcome):
    statuses.append(library.meniscus_outcome_status(outcome.address))
    free(outcome)
_native.Flag, _native.Outcome.__del__ = Flag, freed
x = numpy.random.default_rng(0).uniform(0, 1, (300_000, 3)).astype(numpy.float32)
threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    mf.reconstruct(x, 0.015, voxel=0.3, smoothing={"wavelength": 12})
except KeyboardInterrupt:
    print("interrupted")
print(len(flags), statuses)
assert len(mf.reconstruct(numpy.zeros((1, 3)), 0.1).triangles) > 0
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
        # 3: the library stopped before its end, and its result was freed once.
        self.assertEqual((done.stdout, done.returncode), ("interrupted\n1 [3]\n", 0), done.stderr)

    def test_an_interrupt_at_any_place_leaves_a_call_its_memory(self):
        library, events = _native.library(), []

        class Slow:
            """The library with a call that takes long, and notes what becomes of its memory."""

            def __getattr__(self, name):
                return getattr(library, name)

            def meniscus_reconstruct(self, request):
                time.sleep(0.3)
                events.append(("ends", arrays() is not None))
                return library.meniscus_reconstruct(request)

            def meniscus_cancel_set(self, flag):
                events.append("cancelled")
                library.meniscus_cancel_set(flag)

            def meniscus_cancel_free(self, flag):
                events.append("freed")
                library.meniscus_cancel_free(flag)

        class Waited:
            """A lock whose waits Ctrl-C interrupts at first, right after the lock was taken or before."""

            def __init__(self, is_taken):
                self.lock, self.left, self.is_taken = _thread.allocate_lock(), 2, is_taken

            def acquire(self, **options):
                if options and self.left:
                    self.left -= 1
                    if self.is_taken:
                        self.lock.acquire(**(options | {"timeout": 5}))
                    raise KeyboardInterrupt
                return self.lock.acquire(**options)

            def release(self):
                self.lock.release()

        def start_and_interrupt(call, arguments):
            _thread.start_new_thread(call, arguments)
            raise KeyboardInterrupt

        plain = {"start_new_thread": _thread.start_new_thread, "allocate_lock": _thread.allocate_lock}
        for case, changed in {
            "right after the start": {"start_new_thread": start_and_interrupt},
            "before the lock is taken": {"allocate_lock": lambda: Waited(False)},
            "after the lock was taken": {"allocate_lock": lambda: Waited(True)},
            "both": {"start_new_thread": start_and_interrupt, "allocate_lock": lambda: Waited(True)},
        }.items():
            with self.subTest(case):
                positions = self.positions.astype(float)
                events.clear()
                loaded, module = _native._loaded, _mesh._thread
                column = _mesh._column

                def noted(*arguments, **options):
                    nonlocal arrays
                    array = column(*arguments, **options)
                    arrays = weakref.ref(array)
                    return array

                arrays = None
                _native._loaded, _mesh._thread, _mesh._column = Slow(), types.SimpleNamespace(**(plain | changed)), noted
                try:
                    with self.assertRaises(KeyboardInterrupt):
                        mf.reconstruct(positions, SPACING)
                    ended = list(events)
                    gc.collect()
                finally:
                    _native._loaded, _mesh._thread, _mesh._column = loaded, module, column
                # It ended before the caller may change the arrays.
                self.assertIn(("ends", True), ended)
                self.assertEqual((events.count("freed"), events[-1]), (1, "freed"), events)
                self.assertTrue("cancelled" in events[:2], events)

    @unittest.skipUnless(hasattr(signal, "setitimer"), "this system has no timer that signals")
    def test_many_interrupts_neither_block_nor_end_the_interpreter(self):
        script = """
import random, signal, time, numpy, meniscus_fx as mf
x = numpy.random.default_rng(0).uniform(0, 0.2, (200, 3)).astype(numpy.float32)
left = interrupted = calls = 0
def interrupt(*_):
    global left
    if left:
        left -= 1
        raise KeyboardInterrupt
signal.signal(signal.SIGALRM, interrupt)
random.seed(1)
def once():
    global left, calls
    left = random.randint(1, 3)
    signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-4, 2e-2), 1e-3)
    mf.reconstruct(x, 0.05, threads=1)
    calls += 1
end = time.monotonic() + 2
while time.monotonic() < end:
    try:
        try:
            try:
                once()
            finally:
                left = 0
        except KeyboardInterrupt:
            interrupted += 1
    except KeyboardInterrupt:
        left = 0
signal.setitimer(signal.ITIMER_REAL, 0)
print(interrupted > 3)
"""
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
        self.assertEqual((done.stdout, done.returncode), ("True\n", 0), done.stderr)


class Checkout(unittest.TestCase):
    def test_a_missing_library_is_reported_with_the_next_step(self):
        path = _native.PATH
        loaded, _native._loaded, _native.PATH = _native._loaded, None, pathlib.Path("nowhere.so")
        try:
            with self.assertRaisesRegex(mf.MeniscusError, r"nowhere\.so: cannot load the library.*docs/python\.md"):
                mf.reconstruct(numpy.zeros((1, 3)), 0.1)
        finally:
            _native._loaded, _native.PATH = loaded, path

    def test_another_interface_is_reported_before_its_functions_are_looked_up(self):
        class Older:
            @staticmethod
            def meniscus_abi():
                return 7

        for found, library in (("7", Older()), ("None", object())):
            loaded, load, _native._loaded, ctypes.CDLL = _native._loaded, ctypes.CDLL, None, lambda _, library=library: library
            try:
                with self.subTest(found), self.assertRaisesRegex(mf.MeniscusError, f"found interface {found}, expected {_native.ABI}"):
                    _native.library()
            finally:
                _native._loaded, ctypes.CDLL = loaded, load


if __name__ == "__main__":
    unittest.main()
