# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reads volume files back with OpenVDB and compares every value and the tree with the written ones.

    MENISCUS_VDB_DIR=DIR cargo test --lib export::vdb::tests::every_case_reads_back
    python tools/blender/tests/volumes.py DIR

The test writes each case in every precision and compression, and `CASE.json` with the input. OpenVDB is the module
in bpy, or `openvdb` or `pyopenvdb` of the system. Compared for each grid: type, class, precision, vector type,
background, transform and metadata; every active node and its value, bit for bit; the leaves, the tiles that are
inside and all other inactive values. With MENISCUS set to the binary, a sphere that OpenVDB wrote is meshed; with
MENISCUS_SHOT set to a shot folder, too, a frame of it is made in every precision and compression, and its three grids
hold the same however they are packed, and in half floats the same rounded. The last line is `N grids equal`; the exit
code is 1 if any is not.
"""

import json
import math
import os
import re
import struct
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path

import numpy


def load_openvdb():
    try:
        import bpy

        bpy.utils.expose_bundled_modules()
    except ImportError:
        pass
    try:
        import openvdb
    except ImportError:
        import pyopenvdb as openvdb
    return openvdb


def stored(values, half):
    """Numbers as a file holds them, by numpy's own rounding."""
    single = numpy.asarray(values, numpy.float32)
    return single.astype(numpy.float16).astype(numpy.float32) if half else single


def bits(value):
    """A value as the bytes of its numbers, which distinguish zero from minus zero."""
    numbers = value if isinstance(value, (tuple, list)) else [value]
    return struct.pack(f"={len(numbers)}f", *numbers)


def leaf_of(node):
    return tuple(v >> 3 for v in node)


def expect(good, what):
    if not good:
        raise AssertionError(what)


def same(found, wanted, what):
    expect(found == wanted, f"{what}: found {found!r}, expected {wanted!r}")


def compare_head(grid, wanted, half, compression):
    vector = wanted["name"] == "velocity"
    same(grid.valueTypeName, "vec3s" if vector else "float", "type")
    same(str(grid.gridClass), wanted["class"], "class")
    same(str(grid.vectorType), "contravariant relative" if vector else "invariant", "vector type")
    same(grid.saveFloatAsHalf, half, "half")
    background = stored(wanted["background"], half)
    same(bits(grid.background), bits([background] * 3 if vector else background), "background")
    size = float(numpy.float32(wanted["voxel"]))
    same(tuple(grid.transform.voxelSize()), (size,) * 3, "voxel size")
    same(tuple(grid.transform.indexToWorld((8, -3, 1))), (8 * size, -3 * size, size), "place of a node")
    same(tuple(grid.transform.worldToIndex((0, 0, 0))), (0, 0, 0), "node of the origin")
    packed = {"blosc": "blosc + active values", "zip": "zip + active values", "none": "active values"}
    same(grid.metadata["file_compression"], packed[compression], "compression")
    same(grid.metadata["file_voxel_count"], len(wanted["active"]), "voxel count")
    if wanted["active"]:
        low, high = grid.evalActiveVoxelBoundingBox()
        same(tuple(grid.metadata["file_bbox_min"]), tuple(low), "lowest node")
        same(tuple(grid.metadata["file_bbox_max"]), tuple(high), "highest node")


def compare_values(grid, wanted, half):
    found = {}
    for item in grid.citerOnValues():
        same((item.count, item.depth), (1, 3), "an active value is a voxel")
        found[tuple(item.min)] = bits(item.value)
    values = stored([parts for _, _, _, parts in wanted["active"]], half)
    written = {(i, j, k): value.tobytes() for (i, j, k, _), value in zip(wanted["active"], values)}
    wrong = [node for node in found.keys() | written.keys() if found.get(node) != written.get(node)]
    expect(not wrong, f"{len(wrong)} of {len(written)} active values differ, one of them at {wrong[:1]}")


def compare_tree(grid, wanted, half):
    leaves = {tuple(leaf) for leaf in wanted["leaves"]}
    tiles = {tuple(tile) for tile in wanted["tiles"]}
    lower = {tuple(v >> 4 for v in brick) for brick in leaves | tiles}
    upper = {tuple(v >> 5 for v in node) for node in lower}
    same(grid.leafCount(), len(leaves), "leaves")
    same(grid.nonLeafCount(), 1 + len(lower) + len(upper), "inner nodes and the root")
    minus = {tuple(node) for node in wanted["minus"]}
    # Each leaf of the case has a value of its own, so that equal values and an equal number of leaves leave no other leaf.
    same({leaf_of(node[:3]) for node in wanted["active"]} | set(map(leaf_of, minus)), leaves, "leaves with a value")

    # Of millions of inactive values, those of the background are not kept.
    plus_bits, minus_bits = bits(grid.background), bits([-stored(wanted["background"], half)])
    found = {}
    for item in grid.citerOffValues():
        if bits(item.value) != plus_bits:
            found[tuple(item.min)] = (bits(item.value), item.depth, item.count)
    expected = {node: (minus_bits, 3, 1) for node in minus}
    expected |= {tuple(8 * v for v in tile): (minus_bits, 2, 512) for tile in tiles}
    wrong = [node for node in found.keys() | expected.keys() if found.get(node) != expected.get(node)]
    expect(not wrong, f"{len(wrong)} inactive values differ, one of them at {wrong[:1]}")


def check_import(openvdb, folder, meniscus):
    """A sphere that OpenVDB writes becomes a closed mesh of the right volume; returns the errors."""
    sphere = openvdb.createLevelSetSphere(1.5, (0.25, -0.5, 1.0), 0.1, 3.0)
    sphere.name = "ball"
    path = folder / "sphere.vdb"
    openvdb.write(str(path), grids=[sphere])
    command = [meniscus, "mesh", str(path), "-o", str(folder / "meshed"), "--force", "--progress", "plain"]
    run = subprocess.run(command, capture_output=True, encoding="utf-8")
    figures = re.search(r"volume ([0-9.]+) m³  1 components", run.stderr)
    exact = 4.0 / 3.0 * math.pi * 1.5**3
    if run.returncode != 0 or not figures or abs(float(figures[1]) / exact - 1.0) > 0.005:
        return f"exit code {run.returncode}, volume of {exact:.4f} m³ expected: {run.stderr}"
    return ""


def everything(grid):
    """The type, active voxels, bounds and every value between them, as an array of bits."""
    low, high = grid.evalActiveVoxelBoundingBox()
    shape = [high[axis] - low[axis] + 1 for axis in range(3)]
    vector = [3] if grid.valueTypeName == "vec3s" else []
    values = numpy.zeros(shape + vector, numpy.float32)
    grid.copyToArray(values, ijk=low)
    return (grid.valueTypeName, grid.activeVoxelCount(), low, high), values


def check_shot(openvdb, folder, meniscus, shot):
    """The volumes of a frame are the same for every compression; returns the number of grids, and the errors."""
    wrong, equal, plain = [], 0, {}
    for precision, compression in product(("float", "half"), ("none", "zip", "blosc")):
        out = folder / f"shot_{precision}_{compression}"
        flags = ["--frames", "4", "--precision", precision, "--compression", compression, "--progress", "none"]
        subprocess.run([meniscus, "volume", shot, "-o", str(out), *flags], check=True, stdout=subprocess.DEVNULL)
        grids, _ = openvdb.readAll(str(next(out.glob("volume/*.vdb"))))
        if [grid.name for grid in grids] != ["density", "surface", "velocity"]:
            wrong.append(f"{precision}, {compression}: grids {[grid.name for grid in grids]}")
        for grid in grids:
            about, values = everything(grid)
            first = plain.setdefault(grid.name, (about, values))
            # Half files keep background and inactive values in full size, which is the same here: halves of them.
            wanted = first[1] if precision == "float" else first[1].astype(numpy.float16).astype(numpy.float32)
            close = numpy.array_equal(values.view(numpy.uint32), wanted.view(numpy.uint32))
            if about == first[0] and close and about[1] > 1000:
                equal += 1
            else:
                wrong.append(f"{precision}, {compression}, {grid.name}: {about}, {first[0]}, values equal: {close}")
        del grids, grid
    return equal, wrong


def main():
    openvdb = load_openvdb()
    folder = Path(sys.argv[1])
    equal, failed = 0, 0
    cases = sorted(folder.glob("*.json"))
    assert cases, f"no cases in {folder}"
    for path, precision, compression in product(cases, ("float", "half"), ("blosc", "zip", "none")):
        case = json.loads(path.read_text(encoding="utf-8"))
        file = folder / f"{case['name']}_{precision}_{compression}.vdb"
        grids, about = openvdb.readAll(str(file))
        same((about["creator"], about["meniscus_key"]), ("Meniscus", f"{0xfeed:016x}"), "metadata of the file")
        same([grid.name for grid in grids], [grid["name"] for grid in case["grids"]], "grids")
        for grid, wanted in zip(grids, case["grids"]):
            half = precision == "half"
            try:
                compare_head(grid, wanted, half, compression)
                compare_values(grid, wanted, half)
                compare_tree(grid, wanted, half)
                equal += 1
            except AssertionError as why:
                failed += 1
                print(f"FAIL {file.name}, {grid.name}: {why}", flush=True)
        # Grids outlive their file otherwise, and the module complains about that at exit.
        del grids, grid
    with tempfile.TemporaryDirectory() as scratch:
        if meniscus := os.environ.get("MENISCUS"):
            wrong = check_import(openvdb, Path(scratch), meniscus)
            failed += bool(wrong)
            print(f"FAIL a level set of OpenVDB: {wrong}" if wrong else "a level set of OpenVDB is meshed", flush=True)
            if shot := os.environ.get("MENISCUS_SHOT"):
                of_shot, wrong = check_shot(openvdb, Path(scratch), meniscus, shot)
                equal, failed = equal + of_shot, failed + len(wrong)
                print("\n".join(f"FAIL {line}" for line in wrong) or f"{of_shot} grids of a shot are the same", flush=True)
    version = ".".join(map(str, openvdb.LIBRARY_VERSION))
    print(f"OpenVDB {version}: {failed} grids differ")
    print(f"{equal} grids equal", flush=True)
    return 1 if failed or not equal else 0


if __name__ == "__main__":
    sys.exit(main())
