# SPDX-License-Identifier: MIT OR Apache-2.0
"""An independent reader and writer of the binary PLY that Meniscus writes: numpy only, no Blender.

Little endian, float, uint and uchar vertex properties in any number, faces as one list of uchar count and uint
corners, all triangles. Anything else is refused: a test never compares against something half understood.
"""

from pathlib import Path

import numpy as np

PROPERTIES = ("x", "y", "z", "nx", "ny", "nz", "vx", "vy", "vz")
SCALARS = {"float": "<f4", "float32": "<f4", "uint": "<u4", "uint32": "<u4", "double": "<f8", "uchar": "u1"}
FACE = np.dtype([("count", "u1"), ("corner", "<u4", (3,))])


def read(path: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Returns the vertex columns by name and the triangles (N x 3, uint32)."""
    data = Path(path).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = [line.split() for line in data[:end].decode("ascii").splitlines()]
    if lines[0] != ["ply"] or lines[1] != ["format", "binary_little_endian", "1.0"]:
        raise ValueError(f"{path}: not a binary little endian PLY")
    elements: dict[str, int] = {}
    properties: dict[str, list[list[str]]] = {}
    current = ""
    for words in lines[2:-1]:
        if words[0] == "element":
            current = words[1]
            elements[current] = int(words[2])
            properties[current] = []
        elif words[0] == "property":
            properties[current].append(words[1:])
        elif words[0] not in ("comment", "obj_info"):
            raise ValueError(f"{path}: unexpected header line {words}")
    if list(elements) != ["vertex", "face"]:
        raise ValueError(f"{path}: elements {list(elements)}, expected vertex and face")
    if any(p[0] not in SCALARS for p in properties["vertex"]):
        raise ValueError(f"{path}: a vertex property that is neither float, double, uint nor uchar")
    face = properties["face"]
    if len(face) != 1 or face[0][:3] not in (["list", "uchar", "uint"], ["list", "uint8", "uint32"]):
        raise ValueError(f"{path}: face property {face}, expected one list of uchar and uint")
    names = [p[1] for p in properties["vertex"]]
    vertex = np.dtype([(name, SCALARS[kind]) for kind, name in properties["vertex"]])
    size = elements["vertex"] * vertex.itemsize + elements["face"] * FACE.itemsize
    if len(data) - end != size:
        raise ValueError(f"{path}: {len(data) - end} bytes of data, the header promises {size}")
    vertices = np.frombuffer(data, vertex, elements["vertex"], end)
    faces = np.frombuffer(data, FACE, elements["face"], end + vertices.nbytes)
    if np.any(faces["count"] != 3):
        raise ValueError(f"{path}: a face that is not a triangle")
    return {name: vertices[name].copy() for name in names}, faces["corner"].copy()


def write(path: Path, columns: dict[str, np.ndarray], triangles: np.ndarray | None) -> None:
    """Writes vertex columns, and triangles unless they are points, in the layout of the Meniscus exporter."""
    vertices = np.zeros(len(columns["x"]), [(name, "<f4") for name in columns])
    for name, values in columns.items():
        vertices[name] = values
    faces = np.zeros(0 if triangles is None else len(triangles), FACE)
    if triangles is not None:
        faces["count"] = 3
        faces["corner"] = triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in columns]
    if triangles is not None:
        header += [f"element face {len(faces)}", "property list uchar uint vertex_indices"]
    header += ["end_header", ""]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_bytes("\n".join(header).encode("ascii") + vertices.tobytes() + faces.tobytes())
