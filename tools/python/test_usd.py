"""Reads stages of `meniscus usd` with OpenUSD, and compares every array with the files that they were made of.

    MENISCUS=target/release/meniscus MENISCUS_STAGE=shot python -m unittest discover tools/python

MENISCUS_STAGE is a shot folder with PLY meshes, whitewater and a camera; it is not written. Without the variables every test is skipped; with them
`usd-core` and all its modules are needed.
"""

import json
import os
import pathlib
import subprocess
import tempfile
import unittest

import numpy

MENISCUS = os.environ.get("MENISCUS")
SHOT = os.environ.get("MENISCUS_STAGE")

# With a stage to read, a missing module is a failure.
if SHOT:
    from pxr import Sdf, Usd, UsdGeom, UsdUtils, UsdValidation

# Every array of a stage is compared under these options, with axes and units applied to what the files have.
OPTIONS = {
    "as it is": ((), numpy.eye(3), 1.0),
    "Houdini": (("--up", "y", "--names", "houdini"), [[1, 0, 0], [0, 0, 1], [0, -1, 0]], 1.0),
    "Maya": (("--up", "y", "--scale", "100", "--names", "maya"), [[1, 0, 0], [0, 0, 1], [0, -1, 0]], 100.0),
}
ALIASES = {"Houdini": "primvars:v", "Maya": "primvars:velocityPV"}


def read_ply(path):
    """The columns of a binary PLY file and its triangles; None of points."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    kinds = {"float": "<f4", "uint": "<u4", "double": "<f8"}
    columns, counts = [], {}
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[0] == "element":
            counts[words[1]] = int(words[2])
        if words[0] == "property" and words[1] in kinds:
            columns.append((words[2], kinds[words[1]]))
    vertices = numpy.frombuffer(data, columns, counts["vertex"], end)
    if "face" not in counts:
        return vertices, None
    faces = numpy.frombuffer(data, [("count", "u1"), ("corners", "<u4", 3)], counts["face"], end + vertices.nbytes)
    return vertices, faces["corners"]


def stacked(vertices, *names):
    return numpy.stack([vertices[name] for name in names], 1)


def scaled(values, scale):
    """Numbers in units of the stage, rounded once."""
    return (values.astype("f8") * scale).astype("f4")


@unittest.skipUnless(MENISCUS and SHOT, "MENISCUS or MENISCUS_STAGE is missing")
class Stages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.shot = pathlib.Path(SHOT)
        cls.manifest = json.loads((cls.shot / "shot.json").read_text())

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def stage(self, name, shot=None):
        """The stage of a shot with the options of this name, and the folder it is in."""
        work = pathlib.Path(self.folder.name) / name.replace(" ", "-")
        options = OPTIONS[name][0]
        command = [MENISCUS, "usd", shot or self.shot, "-o", work, *options, "--progress", "none"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return Usd.Stage.Open(str(work / "usd/shot.usda")), work / "usd"

    def outputs(self, kind, extension):
        found = [o for o in self.manifest["outputs"] if (o["kind"], o["format"]) == (kind, extension)]
        self.assertTrue(found, f"{self.shot} has no {kind}")
        return found

    def equal(self, found, expected, what):
        found = numpy.array(found, dtype=expected.dtype).reshape(expected.shape)
        self.assertTrue(numpy.array_equal(found, expected), what)

    def test_arrays_are_those_of_the_mesh_of_each_frame(self):
        for name, (_, turn, scale) in OPTIONS.items():
            stage, _ = self.stage(name)
            turn = numpy.array(turn, "f4")
            for output in self.outputs("mesh", "ply"):
                mesh = UsdGeom.Mesh.Get(stage, f"/shot/mesh/{output['name']}")
                span = output["frames"]
                frames = list(range(span["first"], span["last"] + 1, span["step"]))
                self.assertEqual(mesh.GetPointsAttr().GetTimeSamples(), frames)
                counts = set()
                for frame in frames:
                    vertices, triangles = read_ply(self.shot / output["pattern"].format(frame))
                    counts.add(len(vertices))
                    points = scaled(stacked(vertices, "x", "y", "z"), scale) @ turn.T
                    velocities = scaled(stacked(vertices, "vx", "vy", "vz"), scale) @ turn.T
                    what = f"{name}, frame {frame}"
                    self.equal(mesh.GetPointsAttr().Get(frame), points, what)
                    self.equal(mesh.GetVelocitiesAttr().Get(frame), velocities, what)
                    self.equal(mesh.GetNormalsAttr().Get(frame), stacked(vertices, "nx", "ny", "nz") @ turn.T, what)
                    self.equal(mesh.GetFaceVertexIndicesAttr().Get(frame), triangles.ravel().astype("i4"), what)
                    self.equal(mesh.GetFaceVertexCountsAttr().Get(frame), numpy.full(len(triangles), 3, "i4"), what)
                    extent = numpy.stack([points.min(0), points.max(0)])
                    self.equal(mesh.GetExtentAttr().Get(frame), extent, what)
                    if name in ALIASES:
                        self.equal(mesh.GetPrim().GetAttribute(ALIASES[name]).Get(frame), velocities, what)
                self.assertEqual(len(counts), len(frames), "the topology changes in every frame")
                # Between frames nothing is interpolated, whatever the counts are.
                half = frames[0] + 0.5
                self.equal(mesh.GetPointsAttr().Get(half), numpy.array(mesh.GetPointsAttr().Get(frames[0])), "between")
                self.assertEqual(mesh.GetSubdivisionSchemeAttr().Get(), "none")
                self.assertEqual(mesh.GetOrientationAttr().Get(), "rightHanded")
                self.assertEqual(mesh.GetNormalsInterpolation(), "vertex")

    def test_points_have_the_particles_of_each_frame(self):
        stage, _ = self.stage("Maya")
        turn, scale = numpy.array(OPTIONS["Maya"][1], "f4"), 100.0
        for output in self.outputs("points", "ply"):
            points = UsdGeom.Points.Get(stage, f"/shot/points/{output['name']}")
            total = 0
            for frame in range(output["frames"]["first"], output["frames"]["last"] + 1):
                vertices, _ = read_ply(self.shot / output["pattern"].format(frame))
                total += len(vertices)
                places = scaled(stacked(vertices, "x", "y", "z"), scale) @ turn.T
                self.equal(points.GetPointsAttr().Get(frame), places, frame)
                velocities = scaled(stacked(vertices, "vx", "vy", "vz"), scale) @ turn.T
                self.equal(points.GetVelocitiesAttr().Get(frame), velocities, frame)
                self.equal(points.GetWidthsAttr().Get(frame), 2 * scaled(vertices["radius"], scale), frame)
                primvars = UsdGeom.PrimvarsAPI(points)
                self.equal(points.GetIdsAttr().Get(frame), vertices["id"].astype("i8"), frame)
                for name, kind in ("age", "f4"), ("kind", "i4"):
                    primvar = primvars.GetPrimvar(name)
                    self.assertEqual(primvar.GetInterpolation(), "vertex")
                    self.equal(primvar.Get(frame), vertices[name].astype(kind), name)
                computed = UsdGeom.Boundable.ComputeExtentFromPlugins(points, frame)
                self.equal(points.GetExtentAttr().Get(frame), numpy.array(computed, "f4"), "extent")
            self.assertGreater(total, 0, "no frame has points")

    def test_axes_units_times_and_camera_are_those_of_the_shot(self):
        camera = self.manifest["camera"]
        for name, (_, turn, scale) in OPTIONS.items():
            stage, _ = self.stage(name)
            self.assertEqual(UsdGeom.GetStageUpAxis(stage), "Z" if name == "as it is" else "Y")
            self.assertEqual(UsdGeom.GetStageMetersPerUnit(stage), 1.0 / scale)
            self.assertEqual(stage.GetTimeCodesPerSecond(), self.manifest["fps"])
            self.assertEqual(stage.GetStartTimeCode(), self.manifest["frames"]["first"])
            self.assertEqual(stage.GetEndTimeCode(), self.manifest["frames"]["last"])
            self.assertEqual(stage.GetDefaultPrim().GetPath(), "/shot")
            shown = UsdGeom.Camera.Get(stage, "/shot/camera").GetCamera(1.0)
            # Tenths of a unit.
            self.assertAlmostEqual(shown.focalLength / 10 / scale * 1000, camera["focal_length"], 4)
            self.assertAlmostEqual(shown.horizontalAperture / 10 / scale * 1000, 36.0, 4)
            matrix = numpy.array(shown.transform)
            place, target = (numpy.array(turn) @ camera[key] for key in ("position", "target"))
            self.assertLess(numpy.abs(matrix[3, :3] / scale - place).max(), 1e-6)
            view = (target - place) / numpy.linalg.norm(target - place)
            self.assertLess(numpy.abs(-matrix[2, :3] - view).max(), 1e-6)
            up = numpy.array(turn) @ [0, 0, 1]
            self.assertLess(abs(matrix[0, :3] @ up), 1e-9, "upright")
            self.assertGreater(matrix[1, :3] @ up, 0.0)

    def test_layers_are_complete_and_by_themselves_valid(self):
        stage, folder = self.stage("Maya")
        layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(folder / "shot.usda"))
        self.assertFalse(unresolved)
        used = {pathlib.Path(layer.realPath).name for layer in layers}
        used |= {pathlib.Path(asset).name for asset in assets}
        self.assertEqual(used, {path.name for path in folder.glob("*.usd?")})
        for path in folder.glob("*.usdc"):
            alone = Usd.Stage.Open(str(path))
            self.assertTrue(alone.GetDefaultPrim(), path)
            self.assertEqual(alone.GetTimeCodesPerSecond(), self.manifest["fps"])
            # A layer that OpenUSD writes of the same content has the same content.
            text = Sdf.Layer.FindOrOpen(str(path)).ExportToString()
            again = Sdf.Layer.CreateAnonymous(".usdc")
            self.assertTrue(again.ImportFromString(text))
            self.assertEqual(again.ExportToString(), text)
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        self.assertGreater(len(validators), 10)
        faults = UsdValidation.ValidationContext(validators).Validate(stage)
        self.assertEqual([fault.GetMessage() for fault in faults], [])

    def test_velocities_of_frames_predict_the_next(self):
        """Units a second: points that are moved by velocity / fps are near those of the next frame."""
        stage, _ = self.stage("Maya")
        mesh = UsdGeom.Mesh.Get(stage, f"/shot/mesh/{self.outputs('mesh', 'ply')[0]['name']}")
        frames = mesh.GetPointsAttr().GetTimeSamples()
        at = frames[-2]
        moved = numpy.array(mesh.ComputePointsAtTime(at + 0.5, at))
        points, velocities = (numpy.array(a.Get(at)) for a in (mesh.GetPointsAttr(), mesh.GetVelocitiesAttr()))
        expected = points + velocities * 0.5 / self.manifest["fps"]
        self.assertLess(numpy.abs(moved - expected).max(), 1e-3, "OpenUSD takes them as units a second")
        # Some of the fastest tenth, of which each moves by more than a voxel.
        speeds = numpy.linalg.norm(velocities, axis=1)
        fastest = numpy.nonzero(speeds >= numpy.quantile(speeds, 0.9))[0]
        fastest = fastest[:: max(len(fastest) // 300, 1)]
        following = numpy.array(mesh.GetPointsAttr().Get(frames[-1]))

        def distance(seconds):
            """The mean distance of points that have moved for so long to those of the next frame."""
            places = points[fastest] + velocities[fastest] * seconds
            return numpy.mean([numpy.linalg.norm(following - place, axis=1).min() for place in places])

        at_rest, step, double = (distance(count / self.manifest["fps"]) for count in (0, 1, 2))
        self.assertLess(2 * step, at_rest, "moved points are nearer than those at rest")
        self.assertLess(2 * step, double, "moved points are nearer than those moved twice as far")


if __name__ == "__main__":
    unittest.main()
