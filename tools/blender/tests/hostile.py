# SPDX-License-Identifier: MIT OR Apache-2.0
"""Shot folders from a stranger: each case imports one that is malicious or damaged. One stage for run.py.

    python tools/blender/tests/hostile.py hostile WORK_DIR [CASE...]      all cases, or those named, such as `links`

Either the import is refused, with one line that has the place and the next step, or it shows what is sound and reports
the rest.
"""

import ast
import inspect
import json
import os
import struct
import sys
from pathlib import Path

import bpy
import numpy as np

import harness
import ply
import synthetic
from harness import ADDON, change, check, expect, forbid, imported, refused, use_addon

COMMAND = "openjd_env: LD_PRELOAD=evil.so"
CODE = "'+__import__('os').system('true')+'"
OUTSIDE = [
    "/etc/x_{:04}.ply", "../x_{:04}.ply", "mesh/../../x_{:04}.ply", "..\\x_{:04}.ply", "mesh\\x_{:04}.ply",
    "C:/x_{:04}.ply", "C:x_{:04}.ply", "//server/share/x_{:04}.ply", "\\\\server\\share\\x_{:04}.ply",
    "\\\\?\\C:\\x_{:04}.ply", "~/x_{:04}.ply", "$HOME/x_{:04}.ply", "%TEMP%/x_{:04}.ply", "mesh//x_{:04}.ply",
    "./mesh/x_{:04}.ply", "mesh/./x_{:04}.ply", "mesh/.x_{:04}.ply", "mesh/x.ply:stream_{:04}.ply", "mesh./x_{:04}.ply",
    "mesh/x\n_{:04}.ply", "mesh/x\0_{:04}.ply", "mesh/x\x1b[2J_{:04}.ply", "mesh/\u202e_{:04}.ply", "mesh/\ud800_{:04}.ply",
    "mesh/{}_{:04}.ply", "mesh/" + "x" * 300 + "_{:04}.ply", "m/" * 2000 + "x_{:04}.ply",
]
UNNUMBERED = [
    "mesh/x.ply", "mesh/x_{:04}_{:04}.ply", "mesh_{:04}/x.ply", "mesh/x_{:04}", "mesh/x_{:04}.vdb", "mesh/x_{:00}.ply",
    "mesh/x_{:0\u0664}.ply", "mesh/x_1{:04}.ply", "", 5, None, ["mesh/x_{:04}.ply"],
]
NAMES = ["", " ", "a\nb", "a\0", "\x1b[2J", "\u202eliquid", "\ud800", "a/b", "..", CODE, '"];f', "x" * 64, "x" * 300]
RATES = ["NaN", "Infinity", "-Infinity", "1e999", "true", "-24", "0", "1e300", "null", "[24]", '"24"', "9" * 4000, "9" * 5000]
SPANS = [
    {"last": 2**31}, {"last": 2**63}, {"last": 10**400}, {"first": -1}, {"first": -(2**63)}, {"first": 6}, {"step": 0},
    {"step": -1}, {"step": 2**31}, {"first": True}, {"step": True}, {"last": 1e3}, {"last": 1.5}, {"last": "5"}, {"step": None},
]
PLY_HEAD = (
    "ply\nformat binary_little_endian 1.0\n{comment}element vertex {vertices}\nproperty float x\nproperty float y\n"
    "property float z\n{more}element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n"
)


def ply_bytes(vertices: int = 4, faces: int = 0, size: int = 48, comment: str = "", more: str = "") -> bytes:
    """A PLY whose header need not be true, with `size` bytes of data."""
    return PLY_HEAD.format(vertices=vertices, faces=faces, comment=comment, more=more).encode() + bytes(size)


COLOURS = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
DAMAGED_PLY = {
    "4e9 vertices": ply_bytes(vertices=4_000_000_000),
    "2e9 vertices": ply_bytes(vertices=2_000_000_000),
    "1e20 vertices": ply_bytes(vertices=10**20),
    "4e9 faces": ply_bytes(faces=4_000_000_000),
    "negative vertices": ply_bytes(vertices=-4),
    "too short": ply_bytes(size=47),
    "too long": ply_bytes(size=49),
    "a line of a megabyte": ply_bytes(comment=f"comment {'x' * 1_000_000}\n"),
    "a property twice": ply_bytes(more="property float x\n", size=64),
    "colours as bytes, too long": ply_bytes(more=COLOURS, size=64),
    "one colour as a byte": ply_bytes(more="property uchar red\n", size=52),
    "a list in each vertex": ply_bytes(more="property list uchar uint many\n", size=52),
    "text": b"ply\nformat ascii 1.0\nelement vertex 1\n",
    "no PLY": b"\xff" * 5000,
    "empty": b"",
}


def vdb_text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def vdb_bytes(**values: object) -> bytes:
    """A volume of the grid `density` without nodes, with some values of its headers replaced by others."""
    value = {"version": 224, "library": 12, "has_offsets": 1, "metadata": 1, "metadata_type": vdb_text("string"), "grids": 1}
    value |= {"metadata_value": vdb_text("Meniscus"), "name": vdb_text("density"), "type": vdb_text("Tree_float_5_4_3")}
    value |= {"parent": vdb_text(""), "head": 0, "end": 0, "compression": 2, "transform": vdb_text("UniformScaleMap"), "voxel": 0.1}
    value |= {"buffers": 1, "background": 0.0, "tiles": 0, "children": 0} | values
    content = struct.pack("<QIIIB", 0x56444220, *(value[part] for part in ("version", "library")), 0, value["has_offsets"])
    content += b"6d656e69-7363-7573-8000-766f6c756d65" + struct.pack("<I", value["metadata"])
    content += vdb_text("creator") + value["metadata_type"] + value["metadata_value"] + struct.pack("<I", value["grids"])
    content += value["name"] + value["type"] + value["parent"]
    grid = struct.pack("<II", value["compression"], 0) + value["transform"] + struct.pack("<15d", *[value["voxel"]] * 15)
    grid += struct.pack("<IfII", value["buffers"], value["background"], value["tiles"], value["children"])
    start = len(content) + 24
    end = start + len(grid)
    return content + struct.pack("<qqq", start + value["head"], end + value["end"], end + value["end"]) + grid


LONG = struct.pack("<I", 2**32 - 1)
DAMAGED_VDB = {
    "empty": b"",
    "no volume": b"\xff" * 5000,
    "a mesh": ply_bytes(),
    "magic only": vdb_bytes()[:8],
    "4e9 metadata": struct.pack("<QI", 0x56444220, 224) + b"\xff" * 5000,
    "cut in its header": vdb_bytes()[:100],
    "too short": vdb_bytes()[:-1],
    "too long": vdb_bytes() + b"x",
    "version": vdb_bytes(version=999),
    "library": vdb_bytes(library=2**32 - 1),
    "without offsets": vdb_bytes(has_offsets=0),
    "many metadata": vdb_bytes(metadata=2**32 - 1),
    "a text of 4 GiB": vdb_bytes(metadata_type=LONG),
    "metadata of 4 GiB": vdb_bytes(metadata_value=LONG),
    "metadata of an unknown type": vdb_bytes(metadata_type=vdb_text("evil")),
    "metadata of a false size": vdb_bytes(metadata_type=vdb_text("bool")),
    "many grids": vdb_bytes(grids=2**32 - 1),
    "two grids in place of one": vdb_bytes(grids=2),
    "a name of 4 GiB": vdb_bytes(name=LONG),
    "a type of points": vdb_bytes(type=vdb_text("Tree_ptdataidx32_5_4_3")),
    "a parent": vdb_bytes(parent=vdb_text("density")),
    "a head before its descriptor": vdb_bytes(head=-100),
    "an end behind the file": vdb_bytes(end=2**40),
    "a negative end": vdb_bytes(end=-(2**40)),
    "compression": vdb_bytes(compression=2**32 - 1),
    "transform": vdb_bytes(transform=vdb_text("NonlinearFrustumMap")),
    "a voxel of 0": vdb_bytes(voxel=0.0),
    "a voxel of NaN": vdb_bytes(voxel=np.nan),
    "buffers": vdb_bytes(buffers=2**32 - 1),
    "a background of NaN": vdb_bytes(background=np.nan),
    "4e9 tiles": vdb_bytes(tiles=2**32 - 1),
    "4e9 children": vdb_bytes(children=2**32 - 1),
    "a child without its node": vdb_bytes(children=1),
}
DAMAGED_PC2 = {
    "points": lambda b: b[:16] + struct.pack("<i", 2**31 - 1) + b[20:],
    "negative points": lambda b: b[:16] + struct.pack("<i", -81) + b[20:],
    "samples": lambda b: b[:28] + struct.pack("<i", 2**31 - 1) + b[32:],
    "fewer samples": lambda b: b[:28] + struct.pack("<i", 1) + b[32:],
    "NaN step": lambda b: b[:24] + struct.pack("<f", np.nan) + b[28:],
    "too short": lambda b: b[:-1],
    "too long": lambda b: b + b"x",
    "header cut": lambda b: b[:20],
    "empty": lambda b: b"",
    "no cache": lambda b: b"\xff" * len(b),
}


def edited(name: str, path: Path, edit, *parts: str) -> None:
    """The import of a shot is refused with its path, the parts and a next step, after an edit of its shot.json."""
    before = path.read_bytes()
    change(path, edit)
    refused(name, path, str(path), *parts, "`meniscus shot`")
    path.write_bytes(before)


def spoiled(name: str, shot: Path, path: Path, content: bytes, *parts: str) -> None:
    """The import is refused with the path of a file, after a change of its content."""
    before = path.read_bytes()
    path.write_bytes(content)
    refused(name, shot, str(path), *parts, "`meniscus shot`")
    path.write_bytes(before)


def case_paths_outside(work: Path) -> None:
    path = synthetic.write_shot(work)
    for pattern in OUTSIDE:
        edit = lambda d: d["outputs"][0].update(pattern=pattern)  # noqa: E731
        edited(f"pattern {pattern[:40]!r}", path, edit, '"pattern"', "inside the shot folder")


def case_paths_without_number(work: Path) -> None:
    path = synthetic.write_shot(work)
    for pattern in UNNUMBERED:
        edited(f"pattern {pattern!r}", path, lambda d: d["outputs"][0].update(pattern=pattern), '"pattern"', "{:04}")


def case_sheet_paths_outside(work: Path) -> None:
    path = synthetic.write_sheet(work)
    for part, extension in (("rest", "ply"), ("pattern", "pc2")):
        for pattern in OUTSIDE:
            file = pattern.replace("_{:04}.ply", f".{extension}")
            edit = lambda d: d["outputs"][0].update({part: file})  # noqa: E731
            edited(f"{part} {file[:40]!r}", path, edit, f'"{part}"', "inside the shot folder")
        for file in (5, None, "", f"sheet/sail.{extension}.exe", "sheet/sail_{:04}." + extension):
            edited(f"{part} {file!r}", path, lambda d: d["outputs"][0].update({part: file}), f'"{part}"')


def case_same_path_twice(work: Path) -> None:
    path = synthetic.write_shot(work)
    edited("one pattern twice", path, lambda d: d["outputs"].append(d["outputs"][0] | {"name": "b"}), '"outputs"[1]', "no other output")


def case_names(work: Path) -> None:
    path = synthetic.write_shot(work)
    for name in NAMES:
        edited(f"name {name[:20]!r}", path, lambda d: d["outputs"][0].update(name=name), '"outputs"[0] "name"', "letters a to z")
    for name in (5, None, True, {"a": 1}):
        edited(f"name {name!r}", path, lambda d: d["outputs"][0].update(name=name), '"outputs"[0] "name"', "a text")


def case_rates(work: Path) -> None:
    path = synthetic.write_shot(work)
    text = path.read_text()
    for rate in RATES:
        path.write_text(text.replace('"fps": 24.0', f'"fps": {rate}'))
        refused(f"fps {rate[:9]}", path, str(path), "`meniscus shot`")


def case_frames(work: Path) -> None:
    path = synthetic.write_shot(work)
    for span in SPANS:
        shown = str(span)[:30]
        edited(f"frames {shown}", path, lambda d: d["frames"].update(span), '"frames"')
        edited(f"frames of an output {shown}", path, lambda d: d["outputs"][0]["frames"].update(span), '"outputs"[0] "frames"')
    for span in (5, None, [], {}):
        edited(f"frames {span}", path, lambda d: d.update(frames=span), '"frames"', "whole numbers")
    change(path, lambda d: d["outputs"][0]["frames"].update(first=1048575, last=1048576))
    refused("frames after Blender's last", path, str(path), '"outputs"[0] "frames"', "Simulate the shot with lower")


def case_types(work: Path) -> None:
    path, volume = synthetic.write_shot(work), {"kind": "volume", "format": "vdb"}
    for grids in (5, None, True, "density", [5], {"density": 1}):
        edited(f"grids {grids}", path, lambda d: d["outputs"][0].update(volume, grids=grids), '"grids"', "a list of names")
    edited("attributes", path, lambda d: d["outputs"][0].update(attributes=5), '"attributes"', "an object")
    edited("velocity", path, lambda d: d["outputs"][0].update(attributes={"velocity": [CODE] * 3}), '"velocity"', "vx")
    edited("outputs", path, lambda d: d.update(outputs={"a": 1}), '"outputs"', "a list of objects")
    edited("outputs of lists", path, lambda d: d.update(outputs=[[]]), '"outputs"', "a list of objects")
    edited("kind", path, lambda d: d["outputs"][0].update(kind=["mesh"]), '"outputs"[0] "kind"', "a text")
    edited("title", path, lambda d: d.update(title=["a"] * 9999), '"title"', "a text")
    for version in (True, 1.0, "1", None, 10**400):
        path = synthetic.write_shot(work)
        change(path, lambda d: d.update(version=version))
        refused(f"version {str(version)[:9]}", path, str(path), '"version" is', "Install the add-on")


def case_deep_json(work: Path) -> None:
    path = synthetic.write_shot(work)
    head = path.read_text().rstrip().removesuffix("}")
    nested = {"lists": "[" * 100_000, "closed lists": "[" * 100_000 + "]" * 100_000, "objects": '{"a":' * 100_000}
    nested["a key"] = f'{head}, "more": {"[" * 100_000}{"]" * 100_000}}}'
    for name, text in nested.items():
        path.write_text(text)
        refused(f"nested {name}", path, str(path), "not valid JSON", "`meniscus shot`")
    path.write_bytes(b'{"format": "\xff"}')
    refused("no UTF-8", path, str(path), "not valid JSON", "`meniscus shot`")
    # As deep as the parser goes: comparing and showing such a value must not go deeper.
    deep = "[" * 900 + "]" * 900
    path.write_text(f'{head}, "more": {deep}}}'.replace('"liquid"', deep))
    refused("a nested name", path, str(path), '"name"', "`meniscus shot`")


def case_many_outputs(work: Path) -> None:
    path = synthetic.write_shot(work)
    edited("100 000 outputs", path, lambda d: d.update(outputs=[{"kind": "a"}] * 100_000), "100000", "at most 1000")
    edited("1001 outputs", path, lambda d: d.update(outputs=d["outputs"] * 1001), "1001", "at most 1000")


def case_huge_manifest(work: Path) -> None:
    import resource

    path = synthetic.write_shot(work)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    os.truncate(path, 1 << 30)
    refused("shot.json of 1 GiB", path, str(path), "more than 4194304 bytes", "`meniscus shot`")
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    check(grown < 100 << 10, "of a file of 1 GiB only the start is read", f"{grown} KiB")


def case_billion_frames(work: Path) -> None:
    path = synthetic.write_shot(work)
    for span in ("frames", "outputs"):
        change(path, lambda d: (d["frames"] if span == "frames" else d["outputs"][0]["frames"]).update(last=1_000_000_000))
    shown = imported(path.parent)
    check(len(harness.at_frame(shown, 2).vertices) == 642, "of 10⁹ frames those with files are shown")
    scene = bpy.context.scene
    check((scene.frame_start, scene.frame_end) == (1, 1048574), "the scene ends where Blender's frames do")
    file = path.parent / "mesh" / "liquid_0006.ply"
    expect("Warning: Synthetic: frames 1048575 to 1000000000 cannot be shown, Blender's last is 1048574")
    expect(f"Warning: liquid: 999999995 of 1000000000 files missing, first {file}. Run `meniscus shot` again")
    for file in (path.parent / "mesh").iterdir():
        file.unlink()
    refused("10⁹ frames without a file", path, "1000000000 of 1000000000 files missing", "`meniscus shot`")


def case_ten_thousand_files(work: Path) -> None:
    """One listing of the folder finds the missing frames, one pass over the files the damaged ones."""
    path = synthetic.write_shot(work, last=5, empty=())
    for frame in range(6, 10_001):
        (work / "mesh" / f"liquid_{frame:04}.ply").write_bytes(ply_bytes())
    for frame in (1, 77, 9999):
        (work / "mesh" / f"liquid_{frame:04}.ply").unlink()
    change(path, lambda d: [span.update(last=10_000) for span in (d["frames"], d["outputs"][0]["frames"])])
    calls, scandir = [], os.scandir
    os.scandir = lambda *given: calls.append(given) or scandir(*given)
    try:
        shown = imported(work)
    finally:
        os.scandir = scandir
    check(len(calls) == 1, "the folder is listed once", calls)
    expect(f"Warning: liquid: 3 of 10000 files missing, first {work / 'mesh' / 'liquid_0001.ply'}")
    check(len(harness.at_frame(shown, 10_000).vertices) == 4, "frame 10 000 is shown")
    spoiled("the last of 10 000 files", path, work / "mesh" / "liquid_10000.ply", b"ply", "PLY header")


def case_titles(work: Path) -> None:
    """What Blender prints has no line of the stranger's."""
    path = synthetic.write_shot(work)
    lines = f"a\n{COMMAND}\r{COMMAND}\x1b[2J\u2028{COMMAND}\ud800"
    other = {"kind": lines, "name": lines, "format": lines}
    change(path, lambda d: d.update(title=lines, outputs=d["outputs"] + [other] * 900))
    imported(work)
    expect("Info: a\\nopenjd_env")
    expect("more")
    edited("a format of two lines", path, lambda d: d.update(format=lines), '"format"')
    folder = work / f"b\n{COMMAND}"
    broken = synthetic.write_shot(folder)
    change(broken, lambda d: d.update(fps=0))
    refused("a folder of two lines", broken, "b\\nopenjd_env", '"fps"')
    os.mkfifo(work / "mesh" / f"c\n{COMMAND}")
    refused("a pipe of two lines", path, "c\\nopenjd_env", "neither a file nor a folder")
    forbid("openjd_env")


def case_collisions(work: Path) -> None:
    """What the .blend has keeps its name and data."""
    kept = {}
    for name in ("liquid", "sail"):
        kept[name] = bpy.data.objects.new(name, bpy.data.meshes.new(name))
        bpy.context.scene.collection.objects.link(kept[name])
    for name in ("Water", "Cloth"):
        bpy.data.materials.new(name)["mine"] = True
    group = bpy.data.node_groups.new("Meniscus Sequence", "GeometryNodeTree")
    made = [imported(synthetic.write_shot(work / "mesh").parent), imported(synthetic.write_sheet(work / "sheet").parent)]
    check([shown.name for shown in made] == ["liquid.001", "sail.001"], "objects get a number", made)
    same = all(one.name == one.data.name == name and not one.data.vertices for name, one in kept.items())
    check(same, "objects of the file keep name and mesh", kept)
    used = [material for shown in made for material in shown.data.materials if material.get("mine")]
    check(not used and not group.nodes, "groups and materials of the file are not used", used)


def case_no_code(work: Path) -> None:
    """Nothing that is imported can run code, and no code is made of a text."""
    path = synthetic.write_shot(work)
    strange = {CODE: [CODE], "position": ["x"], "#frame": ["#frame"]}
    change(path, lambda d: d["outputs"][0]["attributes"].update(strange))
    change(path, lambda d: d.update({CODE: CODE, "title": CODE}))
    imported(work)
    collections = [getattr(bpy.data, name) for name in dir(bpy.data)]
    blocks = [block for some in collections if isinstance(some, bpy.types.bpy_prop_collection) for block in some]
    drivers = [b for b in blocks if getattr(b, "animation_data", None) and b.animation_data.drivers]
    check(not drivers and not bpy.data.texts, "no drivers and no texts", drivers)
    trees = [getattr(block, "node_tree", None) or block for block in blocks]
    scripts = [n for tree in trees if isinstance(tree, bpy.types.NodeTree) for n in tree.nodes if "SCRIPT" in n.type]
    check(not scripts, "no script nodes", scripts)
    check(not any(CODE in block.name for block in blocks), "no data-block is named by an attribute")
    source = Path(inspect.getfile(sys.modules[ADDON])).parent
    means = "eval exec compile __import__ driver_add drivers driver_namespace expression texts system popen pickle".split()
    allowed, found = {"re.compile"}, []
    for file in source.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = ast.unparse(node) if isinstance(node, (ast.Name, ast.Attribute)) else ""
            last = name.rpartition(".")[2]
            if last in means and name not in allowed:
                found.append(f"{file.name}: {name}")
    check(not found, "the add-on has no means to run a text", found)


def case_damaged_meshes(work: Path) -> None:
    path = synthetic.write_shot(work)
    for name, content in DAMAGED_PLY.items():
        spoiled(f"mesh: {name}", path, work / "mesh" / "liquid_0004.ply", content, "expected")


def case_invalid_triangles(work: Path) -> None:
    """Blender itself checks the vertex numbers of faces, and takes coordinates that are not finite."""
    path = synthetic.write_shot(work, last=1, empty=())
    table, triangles = ply.read(work / "mesh" / "liquid_0001.ply")
    triangles[0, 1], triangles[1, 2] = 4_000_000_000, 642
    table["x"][:], table["y"][:] = np.nan, np.inf
    ply.write(work / "mesh" / "liquid_0001.ply", table, triangles)
    mesh = harness.at_frame(imported(path.parent), 1)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    check(len(mesh.vertices) == 642 and corners.min() >= 0 and corners.max() < 642, "all corners have a vertex", corners.max())


def case_attribute_names(work: Path) -> None:
    """Vertex properties of a mesh with names that Blender uses itself."""
    for name in ("position", ".corner_vert", ".edge_verts", "material_index", "velocity", "#frame", CODE, "x" * 5000):
        path = synthetic.write_shot(work, last=1)
        # A path of its own: Blender 5.2 keeps meshes that were read by their paths.
        folder = f"mesh{len(bpy.data.objects)}"
        (work / folder).mkdir(exist_ok=True)
        (work / folder / "x_0001.ply").write_bytes(ply_bytes(more=f"property float {name}\n", size=64))
        change(path, lambda d: d["outputs"][0].update(pattern=folder + "/x_{:04}.ply"))
        mesh = harness.at_frame(imported(work), 1)
        check(len(mesh.vertices) == 4, f"a mesh with the property {name[:20]}", len(mesh.vertices))


def case_double_precision(work: Path) -> None:
    """Coordinates far from the origin are in double precision, and the size of a file is that of its types."""
    path = synthetic.write_shot(work, last=1)
    file = work / "mesh" / "liquid_0001.ply"
    points = np.array([[1e4, 0, 0], [1e4 + 1, 0, 0], [1e4, 1, 0]], "<f8")
    vertices = np.zeros(3, [("x", "<f8", (3,)), ("n", "<f4", (3,))])
    vertices["x"] = points
    head = ply_bytes(vertices=3, faces=1, size=0, more="".join(f"property float n{axis}\n" for axis in "xyz"))
    double = head.replace(b"property float x\nproperty float y\nproperty float z", b"property double x\nproperty double y\nproperty double z")
    content = double + vertices.tobytes() + b"\3" + np.arange(3, dtype="<u4").tobytes()
    spoiled("coordinates in double precision, too short", path, file, content[:-1], "expected")
    file.write_bytes(content)
    mesh = harness.at_frame(imported(path.parent), 1)
    far = max(abs(component) for vertex in mesh.vertices for component in vertex.co)
    check(len(mesh.vertices) == 3 and abs(far - 1e4 - 1) < 1e-2, "a mesh in double precision", far)


def case_damaged_sheets(work: Path) -> None:
    path = synthetic.write_sheet(work)
    cache, rest = work / "sheet" / "sail.pc2", work / "sheet" / "sail.ply"
    for name, edit in DAMAGED_PC2.items():
        spoiled(f"point cache: {name}", path, cache, edit(cache.read_bytes()), "expected")
    for name, content in DAMAGED_PLY.items():
        spoiled(f"rest mesh: {name}", path, rest, content, "expected")
    spoiled("rest mesh without points", path, rest, ply_bytes(vertices=0, size=0), "0 points")
    span = {"first": 1, "last": 2**31 - 1, "step": 1}
    change(path, lambda d: d["outputs"][0].update(frames=span))
    refused("a point cache of 2³¹ frames", path, str(cache), "2147483647 samples", "`meniscus shot`")


def volume_shot(work: Path, content: bytes) -> Path:
    """A shot of one volume, of two frames."""
    path = synthetic.write_shot(work)
    (work / "volume").mkdir(exist_ok=True)
    for frame in (1, 2):
        (work / "volume" / f"smoke_{frame:04}.vdb").write_bytes(content)
    output = {"kind": "volume", "name": "smoke", "format": "vdb", "pattern": "volume/smoke_{:04}.vdb"}
    output |= {"frames": {"first": 1, "last": 2, "step": 1}, "grids": ["density", "velocity", CODE]}
    change(path, lambda d: d.update(outputs=[output]))
    return path


def case_damaged_volumes(work: Path) -> None:
    for name, content in DAMAGED_VDB.items():
        path = volume_shot(work, content)
        refused(f"volume: {name}", path, str(work / "volume" / "smoke_0001.vdb"), "expected", "`meniscus shot`")


def case_volume_frames(work: Path) -> None:
    path = volume_shot(work, vdb_bytes())
    shown = imported(path.parent)
    check(shown.type == "VOLUME" and shown.data.frame_duration == 2, "a volume without nodes is imported", shown)
    change(path, lambda d: d["outputs"][0]["frames"].update(first=1, last=2**31 - 1))
    volume = imported(path.parent).data
    check(volume.frame_duration == 1048574, "a volume of 2³¹ frames ends where Blender's frames do", volume.frame_duration)
    expect("Warning: Synthetic: frames 1048575 to 2147483647 cannot be shown, Blender's last is 1048574")
    change(path, lambda d: d["outputs"][0]["frames"].update(first=3))
    refused("a volume of 2³¹ missing frames", path, "smoke_0003.vdb", "2147483645 of 2147483645 files missing", "`meniscus shot`")


def case_other_fields_and_files(work: Path) -> None:
    """Fields and files that the extension does not use are accepted, whatever they hold."""
    for name, value in {"a key": "0123456789abcdef", "a number": 5, "null": None, "code": CODE, "a list": [[]] * 1000}.items():
        path = synthetic.write_shot(work / name.replace(" ", "_"))
        for log in ("log", "mesh", "volume", "points", "sheet"):
            (path.parent / f"{log}.jsonl").write_bytes(b'{"frame": 1}\n\xff')
        change(path, lambda d: d.update(simulation=value))
        check(len(harness.at_frame(imported(path.parent), 2).vertices) == 642, f"`simulation` is ignored: {name}")
    # Nothing at the root is opened, a pipe as little as a log.
    (path.parent / "mesh.jsonl").unlink()
    os.mkfifo(path.parent / "mesh.jsonl")
    check(len(harness.at_frame(imported(path.parent), 2).vertices) == 642, "mesh.jsonl is not opened")


def case_folders_for_files(work: Path) -> None:
    path = synthetic.write_shot(work)
    file = work / "mesh" / "liquid_0002.ply"
    file.unlink()
    file.mkdir()
    refused("a folder for a mesh", path, str(file), "a folder, expected a file", "`meniscus shot`")
    file = work / "file"
    file.write_bytes(b"")
    change(path, lambda d: d["outputs"][0].update(pattern="file/x_{:04}.ply"))
    refused("a file for a folder", path, str(file), "cannot be listed", "Check its path")
    path.unlink()
    path.mkdir()
    refused("a folder for shot.json", path, str(path), "no such file", "`meniscus shot`")


def case_pipes_and_devices(work: Path) -> None:
    """None of them is opened: reading a pipe would wait for ever."""
    path = synthetic.write_shot(work)
    for name in ("liquid_0002.ply", "Liquid_0002.PLY", "unnamed"):
        file = work / "mesh" / name
        file.unlink(missing_ok=True)
        os.mkfifo(file)
        refused(f"a pipe {name}", path, str(file), "neither a file nor a folder", "`meniscus shot`")
        file.unlink()
    path.unlink()
    os.mkfifo(path)
    refused("a pipe for shot.json", path, str(path), "not a regular file", "`meniscus shot`")
    path.unlink()
    path.symlink_to("/dev/zero")
    refused("a device for shot.json", path, str(path), "leads out of the shot folder")
    refused("a device", Path("/dev/zero"), "/dev/zero", "not a regular file")
    sheet = synthetic.write_sheet(work / "sheets")
    cache = work / "sheets" / "sheet" / "sail.pc2"
    cache.unlink()
    os.mkfifo(cache)
    refused("a pipe for a point cache", sheet, str(cache), "neither a file nor a folder")


def case_links(work: Path) -> None:
    """Symbolic links lead to files inside the shot folder, or the shot is refused."""
    path, other = synthetic.write_shot(work / "shot"), synthetic.write_shot(work / "other")
    mesh = work / "shot" / "mesh"
    file, leads = mesh / "liquid_0002.ply", "leads out of the shot folder"
    for target in (other.parent / "mesh" / "liquid_0001.ply", Path("/dev/zero"), work / "nothing"):
        file.unlink()
        file.symlink_to(target)
        refused(f"a link to {target.name}", path, str(file), leads)
    file.unlink()
    file.symlink_to(mesh / "liquid_0001.ply")
    check(len(harness.at_frame(imported(path.parent), 2).vertices) == 642, "a link inside the folder is read")
    file.unlink()
    file.symlink_to(file)
    refused("a link to itself", path, str(file), "cannot be read", "`meniscus shot`")
    file.unlink()
    mesh.rename(work / "elsewhere")
    mesh.symlink_to(work / "elsewhere")
    refused("a link to a folder", path, str(mesh), leads)
    mesh.unlink()
    (work / "elsewhere").rename(work / "shot" / "meshes")
    mesh.symlink_to("meshes")
    imported(path.parent)
    check(True, "a link to a folder inside is read")
    path.unlink()
    path.symlink_to(other)
    refused("a link for shot.json", path, str(path), leads)
    for name in ("sail.ply", "sail.pc2"):
        sheet = synthetic.write_sheet(work / "sheet" / name)
        file = sheet.parent / "sheet" / name
        file.rename(work / name)
        file.symlink_to(work / name)
        refused(f"a link for {name}", sheet, str(file), leads)


def case_folder_names(work: Path) -> None:
    """Blender holds paths of 1023 bytes in UTF-8."""
    deep = work
    while len(str(deep)) < 1000:
        deep /= "x" * min(100, 1010 - len(str(deep)))
    path = synthetic.write_sheet(deep)
    refused("a long path", path, str(deep)[:900], "less than 1024", "shorter path")
    os.makedirs(os.fsencode(work) + b"/\xff")
    strange = Path(os.fsdecode(os.fsencode(work) + b"/\xff"))
    refused("a folder that is not UTF-8", synthetic.write_shot(strange), "\\udcff", "UTF-8")


def case_sound_shots(work: Path) -> None:
    """What the checks accept is still imported: many outputs, and names at their limits."""
    path = synthetic.write_shot(work, empty=())
    output, outputs = json.loads(path.read_text())["outputs"][0], []
    for index in range(100):
        outputs.append(output | {"name": f"{index:03}{'x' * 60}", "pattern": f"mesh/a{index}_{{:04}}.ply"})
        (work / "mesh" / f"a{index}_0001.ply").write_bytes(ply_bytes())
    change(path, lambda d: d.update(outputs=outputs))
    imported(work)
    check({o["name"] for o in outputs} <= set(bpy.data.objects.keys()), "100 outputs have objects of their names")


def stage_hostile(work: Path, *only: Path) -> None:
    """Runs every case, or those named."""
    use_addon()
    cases = {name.removeprefix("case_"): case for name, case in globals().items() if name.startswith("case_")}
    for name in map(str, only or cases):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.preferences.addon_enable(module=ADDON)
        cases[name](work / name)


if __name__ == "__main__":
    harness.run(globals())
