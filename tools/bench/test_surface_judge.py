"""The judge on meshes whose figures are known: `target/surface-venv/bin/python -m unittest discover -s tools/bench`."""

import math
import pathlib
import tempfile
import unittest

import numpy

import surface_judge as judge
import surface_scenes as scenes

TETRAHEDRON = numpy.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CORNERS = numpy.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def sphere(radius, rings=96, around=192):
    """A closed sphere of rings and two poles, faces outward."""
    theta = math.pi * numpy.arange(1, rings) / rings
    phi = 2 * math.pi * numpy.arange(around) / around
    flat = numpy.sin(theta)[:, None]
    body = numpy.stack([flat * numpy.cos(phi), flat * numpy.sin(phi), numpy.cos(theta)[:, None] + 0 * phi], -1)
    x = radius * numpy.concatenate([body.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    faces = []
    for j in range(around):
        k = (j + 1) % around
        faces.append([len(x) - 2, j, k])
        for i in range(rings - 2):
            a, b = i * around, (i + 1) * around
            faces += [[a + j, b + j, b + k], [a + j, b + k, a + k]]
        faces.append([len(x) - 1, (rings - 2) * around + k, (rings - 2) * around + j])
    return x, numpy.array(faces)


def torus(n=12):
    """A closed torus of n × n quadrilaterals."""
    i, j = numpy.divmod(numpy.arange(n * n), n)
    u, v = 2 * math.pi * i / n, 2 * math.pi * j / n
    wide = 3 + numpy.cos(v)
    x = numpy.stack([wide * numpy.cos(u), wide * numpy.sin(u), numpy.sin(v)], 1)
    i2, j2 = (i + 1) % n, (j + 1) % n
    a, b, c, d = i * n + j, i2 * n + j, i2 * n + j2, i * n + j2
    return x, numpy.concatenate([numpy.stack([a, b, c], 1), numpy.stack([a, c, d], 1)])


class Sound(unittest.TestCase):
    def expect(self, x, triangles, **figures):
        found = judge.sound(numpy.asarray(x, float), numpy.asarray(triangles))
        wanted = {"open": 0, "crowded": 0, "turned": 0, "pinched": 0, "degenerate": 0, "components": 1, "unused": 0}
        self.assertEqual({key: found[key] for key in {**wanted, **figures}}, {**wanted, **figures})
        return found

    def test_a_tetrahedron_is_sound(self):
        found = self.expect(CORNERS, TETRAHEDRON, handles=0)
        self.assertAlmostEqual(found["volume"], 1 / 6)
        self.assertAlmostEqual(found["area"], 1.5 + math.sqrt(3) / 2)

    def test_a_torus_has_a_handle(self):
        found = self.expect(*torus(), handles=1)
        self.assertGreater(found["volume"], 0)

    def test_each_fault_is_named(self):
        self.expect(CORNERS, TETRAHEDRON[:3], open=3)
        # A turned triangle disagrees with all three neighbours.
        self.expect(CORNERS, [*TETRAHEDRON[:3], TETRAHEDRON[3][::-1]], turned=3, pinched=3)
        separate = [*CORNERS, *(CORNERS + 5)]
        self.expect(separate, [*TETRAHEDRON, *(TETRAHEDRON + 4)], components=2, handles=0)
        at_vertex = [*CORNERS, *(CORNERS[1:] * -1)]
        mirrored = numpy.array([0, 4, 5, 6])[TETRAHEDRON[:, ::-1]]
        self.expect(at_vertex, [*TETRAHEDRON, *mirrored], pinched=1)
        at_edge = [*CORNERS, [0, -1, 0], [0, 0, -1]]
        self.expect(at_edge, [*TETRAHEDRON, *numpy.array([0, 1, 4, 5])[TETRAHEDRON]], crowded=1, pinched=2)
        self.expect([*CORNERS, [9, 9, 9]], [*TETRAHEDRON, [0, 1, 4]], crowded=1, open=2, pinched=2)
        self.expect([*CORNERS, [9, 9, 9]], TETRAHEDRON, unused=1)

    def test_the_grid_shows_where_vertices_lie_on_its_edges(self):
        random = numpy.random.default_rng(1)
        nodes = 0.0125 * random.integers(0, 30, (6000, 3)) + 17.3
        axis = numpy.arange(6000) % 3
        nodes[numpy.arange(6000), axis] += 0.0125 * random.uniform(0, 1, 6000)
        self.assertAlmostEqual(judge.grid(nodes.astype("f4").astype(float)), 0.0125, delta=2e-7)
        self.assertIsNone(judge.grid(nodes + random.uniform(-0.001, 0.001, nodes.shape)))

    def test_flat_triangles_are_degenerate(self):
        x = [*CORNERS, [0.5, 0, 0]]
        self.expect(x, [*TETRAHEDRON[1:], [0, 2, 4], [4, 2, 1], [0, 4, 1]], degenerate=1, open=0)


class Shapes(unittest.TestCase):
    def test_a_sphere_is_smooth_and_where_it_should_be(self):
        radius, spacing = 2.0, 0.05
        x, triangles = sphere(radius)
        known = {"centre": [0.3, 0.2, 0.1], "particles": 4 / 3 * math.pi * (radius / spacing) ** 3, "spacing": spacing}
        found = judge.ball(x + known["centre"], triangles, x / radius, known)
        self.assertLess(found["roughness"], 1e-9)
        self.assertLess(found["file_normals"], 1e-6)
        self.assertLess(found["face_normals"], 0.5)
        self.assertLess(found["from_mesh"], 1e-9)
        # The middle of a side of this sphere lies under it by its sagitta.
        self.assertLess(found["to_mesh"] * spacing, 1.1 * radius * (1 - math.cos(math.pi / 96)))

        # Moved outward every other vertex by a tenth of a particle radius: an RMS of half that.
        bumped = x * (1 + 0.1 * spacing / 2 / radius * (numpy.arange(len(x)) % 2))[:, None]
        found = judge.ball(bumped + known["centre"], triangles, None, known)
        self.assertAlmostEqual(found["roughness"], 0.05, places=3)
        self.assertAlmostEqual(found["from_mesh"], 0.05, places=6)

    def test_a_hole_in_the_sphere_shows_in_the_distance_to_the_mesh(self):
        x, triangles = sphere(2.0)
        known = {"centre": [0, 0, 0], "particles": 4 / 3 * math.pi * 40**3, "spacing": 0.05}
        kept = triangles[x[triangles].mean(1)[:, 2] < 1.9]
        found = judge.ball(x, kept, None, known)
        self.assertGreater(found["to_mesh"], 10)
        self.assertLess(found["from_mesh"], 1e-9)

    def test_a_slab_is_as_thick_as_it_is(self):
        # The sheet's own frame: 60 by 60 spacings, 1.5 thick.
        known = {"centre": [0.1, 0.2, 0.3], "rotation": scenes.ROTATION.tolist(), "spacing": 0.05}
        n = 121
        i, j = numpy.divmod(numpy.arange((n - 1) ** 2), n - 1)
        a, b, c, d = i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1
        upper = numpy.concatenate([numpy.stack([a, b, c], 1), numpy.stack([a, c, d], 1)])
        u, v = numpy.divmod(numpy.arange(n * n), n)
        plane = numpy.stack([u / 2 - 30, v / 2 - 30, 0 * u], 1)
        x = numpy.concatenate([plane + [0, 0, 0.75], plane - [0, 0, 0.75]])
        triangles = numpy.concatenate([upper, upper[:, ::-1] + n * n])
        found = judge.sheet(0.05 * x @ scenes.ROTATION.T + known["centre"], triangles, known)
        self.assertAlmostEqual(found["thickness"], 1.5, places=2)
        self.assertAlmostEqual(found["sheet_roughness"], 0, places=6)


class Files(unittest.TestCase):
    def test_files_of_both_programs_are_read(self):
        x = CORNERS.astype("<f4")
        for kind, order, place in [("int", "little", "<"), ("uint", "big", ">")]:
            header = f"ply\nformat binary_{order}_endian 1.0\ncomment none\nelement vertex 4\n"
            header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
            header += f"element face 4\nproperty list uchar {kind} vertex_indices\nend_header\n"
            faces = numpy.zeros(4, [("n", "u1"), ("v", place + "u4", 3)])
            faces["n"], faces["v"] = 3, TETRAHEDRON
            body = numpy.concatenate([x, -x], 1).astype(place + "f4").tobytes() + faces.tobytes()
            with tempfile.TemporaryDirectory() as folder:
                path = pathlib.Path(folder) / "mesh.ply"
                path.write_bytes(header.encode() + body)
                found, triangles, normals = judge.read_ply(path)
            self.assertTrue((found == x).all() and (triangles == TETRAHEDRON).all() and (normals == -x).all())


class Scenes(unittest.TestCase):
    def test_scenes_are_the_same_every_time_and_keep_particles_apart(self):
        from scipy.spatial import cKDTree

        for name in ["splash-10k", "ball", "sheet2", "filament", "drop"]:
            x, known = scenes.make(name)
            again, _ = scenes.make(name)
            self.assertTrue((x == again).all() and len(x) == known["particles"])
            nearest = cKDTree(x).query(x, 2)[0][:, 1]
            # Jitter takes at most 0.3 of a spacing along each axis.
            self.assertGreater(nearest.min(), (1 - 2 * scenes.JITTER) * 0.99 * scenes.SPACING)


if __name__ == "__main__":
    unittest.main()
