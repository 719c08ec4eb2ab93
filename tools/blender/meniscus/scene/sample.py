# SPDX-License-Identifier: MIT OR Apache-2.0
"""Looks at the objects with a role in every frame of the scene: world matrices, meshes with modifiers applied, animated settings.

Sampling is a generator, which yields after each frame: a script runs it at once, Blender's window a few frames at a time.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import bpy
import numpy as np

from .. import nodes
from ..messages import ShotError, printable
from ..update import OUTPUT
from . import moving
from .changes import Changes

GEOMETRY = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# Frames of a scene that are looked at; an engine's frame takes seconds.
MAX_FRAMES = 100_000
# Bytes of the places of vertices over time that are held at once, of all objects.
MAX_BYTES = 4 << 30
# Kinds of parents that move an object; others bend it.
RIGID_PARENTS = {"OBJECT", "BONE", "VERTEX", "VERTEX_3"}


@dataclass
class Geometry:
    """Vertices [scene units] in the object's axes, and faces: triangles as rows of vertex numbers, of cloth a list with quads."""

    vertices: np.ndarray
    faces: np.ndarray | list[tuple[int, ...]]


@dataclass
class Sampled:
    """One object over the frames of the scene. Matrices have lengths in metres, vertices are to be multiplied by them."""

    source: bpy.types.Object
    frames: list[int]
    matrices: list[np.ndarray] = field(default_factory=list)
    geometry: Geometry | None = None
    # Vertices in each frame if the shape changes, else only those of the first.
    vertices: list[np.ndarray] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)
    factors: list[float] = field(default_factory=list)
    is_on: list[bool] = field(default_factory=list)
    pins: list[int] = field(default_factory=list)
    # Name of its files and of its outputs in the shot.
    asset: str = ""
    # Whether a mesh of which only the first frame is kept has another shape later.
    changes_later: bool = False

    @property
    def role(self):
        return self.source.meniscus

    def repeat(self, count: int) -> None:
        """Repeats what was sampled: one frame stands for `count` equal ones."""
        for values in (self.matrices, self.rates, self.factors, self.is_on):
            values *= count

    def deforms(self) -> bool:
        return len(self.vertices) > 1


def frame_numbers(scene: bpy.types.Scene) -> list[int]:
    """The frames of the scene. Raises ShotError."""
    numbers = list(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
    if not numbers or len(numbers) > MAX_FRAMES:
        expected = f"1 to {MAX_FRAMES}. Change Start, End and Step in the properties of the output"
        raise ShotError(f"The scene has {len(numbers)} frames, expected {expected}")
    if numbers[0] < 0:
        raise ShotError(f"The scene starts at frame {numbers[0]}, expected 0 or later. Move the animation and the start of the scene")
    return numbers


def takes_part(context: bpy.types.Context, notes: list[str]) -> list[bpy.types.Object]:
    """Objects with a role that are in the view layer and not hidden, by name; the others are reported."""
    # An object that a script has just added is otherwise in no view layer, and hidden.
    context.view_layer.update()
    found = []
    shown = set(context.view_layer.objects)
    for each in sorted(context.scene.objects, key=lambda one: one.name):
        report_instances(each, notes)
        if each.meniscus.role == "NONE":
            continue
        name = printable(each.name)
        if each not in shown:
            notes.append(f"{name} is left out: its collection is excluded from the view layer")
        elif each.hide_viewport or not is_shown(each, context):
            notes.append(f"{name} is left out: it, or its collection, is hidden or disabled in viewports")
        else:
            found.append(each)
    return found


def is_shown(each: bpy.types.Object, context: bpy.types.Context) -> bool:
    """Whether Blender evaluates an object: it is visible, but for the eye of the object itself."""
    if each.visible_get(view_layer=context.view_layer):
        return True
    if not each.hide_get(view_layer=context.view_layer):
        return False
    each.hide_set(False, view_layer=context.view_layer)
    visible = each.visible_get(view_layer=context.view_layer)
    each.hide_set(True, view_layer=context.view_layer)
    return visible


def report_instances(each: bpy.types.Object, notes: list[str]) -> None:
    collection = each.instance_collection if each.instance_type == "COLLECTION" else None
    inside = [one for one in collection.all_objects if one.meniscus.role != "NONE"] if collection else []
    if inside:
        notes.append(f"{printable(each.name)}: {len(inside)} object(s) with a role in this instance are left out. Make the instance real")


@contextmanager
def quiet(context: bpy.types.Context, sources: list[bpy.types.Object]) -> Iterator[None]:
    """Shows objects that only their own eye hides, and switches results off, which would read a file a frame."""
    # A generator that is closed from another window has another context.
    layer = context.view_layer
    scene, before = context.scene, (context.scene.frame_current, context.scene.frame_subframe)
    hidden = [each for each in sources if each.hide_get(view_layer=layer)]
    results = [each for each in scene.objects if each.get(OUTPUT)]
    modifiers = [one for each in results for one in each.modifiers if one.show_viewport and one.name.startswith(nodes.NAME.split()[0])]
    try:
        for each in hidden:
            each.hide_set(False, view_layer=layer)
        for modifier in modifiers:
            modifier.show_viewport = False
        yield
    finally:
        for each in hidden:
            restore(lambda each=each: each.hide_set(True, view_layer=layer))
        for modifier in modifiers:
            restore(lambda modifier=modifier: setattr(modifier, "show_viewport", True))
        restore(lambda: scene.frame_set(before[0], subframe=before[1]))


def restore(undo: Callable[[], None]) -> None:
    """Undoes a change, unless what was changed is gone: between two frames a script may remove an object."""
    try:
        undo()
    except (ReferenceError, RuntimeError):
        pass


def sample(
    context: bpy.types.Context, sources: list[bpy.types.Object], frames: list[int], scale: float, notes: list[str]
) -> Generator[float, None, list[Sampled]]:
    """Samples all objects, inside of `quiet`, and yields the finished part after each frame; the scene is in the first frame afterwards.

    Where nothing moves, the first frame stands for all. Raises ShotError.
    """
    scene = context.scene
    found = [Sampled(each, frames) for each in sources]
    changes, size = Changes(scene, sources), 0
    looked = frames if moving.moves(scene, sources) else frames[:1]
    for index, frame in enumerate(looked):
        scene.frame_set(frame)
        graph = context.evaluated_depsgraph_get()
        if index == 0:
            notes += instances(graph, sources)
        changes.look(graph, index == 0)
        for each in found:
            size += sample_frame(each, graph, index == 0, scale)
            if size > MAX_BYTES:
                text = f"more than {MAX_BYTES >> 30} GiB of vertices over {len(frames)} frames"
                raise ShotError(f"{printable(each.source.name)}: {text}. Use simpler meshes that deform, or fewer frames")
        yield (index + 1) / len(looked)
    notes += changes.notes()
    for each in found:
        each.repeat(len(frames) // len(looked))
    # Settings are read in the first frame, wherever the playhead is.
    scene.frame_set(frames[0])
    return found


def instances(graph: bpy.types.Depsgraph, sources: list[bpy.types.Object]) -> list[str]:
    """Notes on instances that objects with a role make, such as those of geometry nodes."""
    counts = dict.fromkeys((each.name for each in sources), 0)
    for each in graph.object_instances:
        if each.is_instance and each.parent is not None and each.parent.name in counts:
            counts[each.parent.name] += 1
    text = "instance(s) are left out: only its own mesh takes part. Realize them in its geometry nodes, or make them real"
    return [f"{printable(name)}: its {count} {text}" for name, count in counts.items() if count]


def sample_frame(each: Sampled, graph: bpy.types.Depsgraph, is_first: bool, scale: float) -> int:
    """Adds one frame of an object; returns the bytes of the vertices that are kept."""
    evaluated = each.source.evaluated_get(graph)
    matrix = np.array(evaluated.matrix_world, dtype=np.float64)
    matrix[:3, :] *= scale
    if not np.all(np.isfinite(matrix)):
        raise ShotError(f"{printable(each.source.name)}: its world matrix has a NaN or an infinite number. Check its animation")
    each.matrices.append(matrix)
    role = evaluated.meniscus
    each.is_on.append(bool(role.is_on))
    each.factors.append(float(role.factor))
    each.rates.append(float(role.emitter.rate))
    if each.source.type not in GEOMETRY:
        return 0
    if is_first:
        each.geometry = geometry(evaluated, graph, keep_quads=role.role == "CLOTH")
        each.vertices = [each.geometry.vertices]
        each.pins = pinned(each) if role.role == "CLOTH" else []
        return each.geometry.vertices.nbytes
    if not may_deform(each.source) or each.changes_later:
        return 0
    with mesh_of(evaluated, graph) as mesh:
        vertices = places(mesh, each.source.name)
    first = each.vertices[0]
    if role.role == "CLOTH":
        each.changes_later = not np.array_equal(vertices, first)
        return 0
    if len(vertices) != len(first):
        finding = f"{len(first)} vertices in frame {each.frames[0]}, {len(vertices)} in frame {each.frames[len(each.matrices) - 1]}"
        raise ShotError(f"{printable(each.source.name)}: {finding}. A shape that changes over time needs the same vertices in every frame")
    if each.deforms():
        each.vertices.append(vertices)
        return vertices.nbytes
    if np.array_equal(vertices, first):
        return 0
    # Until now it was as in the first frame.
    each.vertices = [first] * (len(each.matrices) - 1) + [vertices]
    return vertices.nbytes


def may_deform(source: bpy.types.Object) -> bool:
    """Whether the mesh of an object can change over time."""
    data = source.data
    is_bent = source.parent is not None and source.parent_type not in RIGID_PARENTS
    return bool(is_bent or source.modifiers or getattr(data, "shape_keys", None) or data.animation_data or source.type in ("META", "CURVE"))


@contextmanager
def mesh_of(evaluated: bpy.types.Object, graph: bpy.types.Depsgraph) -> Iterator[bpy.types.Mesh]:
    """The mesh of an evaluated object, for a moment. Raises ShotError."""
    try:
        mesh = evaluated.to_mesh(preserve_all_data_layers=False, depsgraph=graph)
    except RuntimeError:
        mesh = None
    if mesh is None:
        raise ShotError(f"{printable(evaluated.name)}: has no mesh, expected one for its role. Use a mesh object")
    try:
        yield mesh
    finally:
        evaluated.to_mesh_clear()


def places(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """The vertices of a mesh. Raises ShotError."""
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", vertices)
    if not np.all(np.isfinite(vertices)):
        raise ShotError(f"{printable(name)}: a vertex has a NaN or an infinite coordinate. Clean the mesh up")
    return vertices.reshape(-1, 3)


def geometry(evaluated: bpy.types.Object, graph: bpy.types.Depsgraph, keep_quads: bool) -> Geometry:
    """Vertices and triangles of an evaluated object; quads are kept where cloth wants them. Raises ShotError."""
    with mesh_of(evaluated, graph) as mesh:
        vertices = places(mesh, evaluated.name)
        if keep_quads and all(len(face.vertices) <= 4 for face in mesh.polygons):
            return Geometry(vertices, [tuple(face.vertices) for face in mesh.polygons])
        mesh.calc_loop_triangles()
        corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        return Geometry(vertices, corners.reshape(-1, 3))


def pinned(each: Sampled) -> list[int]:
    """Numbers of the vertices in the group of pins. Raises ShotError."""
    return members(each, each.role.pins, "its pins") if each.role.pins else []


def members(each: Sampled, name: str, purpose: str) -> list[int]:
    """Numbers of the vertices in a vertex group, which has some. Raises ShotError."""
    source = each.source
    group = source.vertex_groups.get(name)
    if group is None:
        raise ShotError(f"{printable(source.name)}: has no vertex group {printable(name)} for {purpose}. Choose one that it has")
    if len(source.data.vertices) != len(each.geometry.vertices):
        finding = f"its modifiers change the number of vertices, so the vertex group for {purpose} does not fit"
        raise ShotError(f"{printable(source.name)}: {finding}. Apply the modifiers")
    weights = ((vertex.index, entry.weight) for vertex in source.data.vertices for entry in vertex.groups if entry.group == group.index)
    found = sorted(index for index, weight in weights if weight >= 0.5)
    if not found:
        raise ShotError(f"{printable(source.name)}: no point of the vertex group {printable(name)} has a weight of 0.5 or more")
    return found
