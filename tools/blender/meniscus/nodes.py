# SPDX-License-Identifier: MIT OR Apache-2.0
"""The geometry node groups that read sequences of meshes and points, and velocities of level sets; a saved file needs neither add-on nor scripts.

Scene Time → whole frame → clamped to the sequence → back to the last frame on its step → Format String → Import PLY or OBJ
→ `velocity` from vx, vy, vz → for surfaces smooth shading; for points balls of their `radius`, or
instances → material. Cycles takes `velocity` in metres a second and divides by the scene's frame rate, so the attribute
holds the file's values unchanged.
"""

from dataclasses import dataclass

import bpy

NAME = "Meniscus Sequence"
REVISION = 4
# What Blender makes of the vertex properties red, green and blue of a PLY file.
COLOUR = "Col"
LEVEL_SET_NAME, LEVEL_SET_STAMP = "Meniscus Level Set Velocity", "meniscus_level_set"


@dataclass(frozen=True)
class Reader:
    """A node group for one kind of file."""

    name: str
    stamp: str
    # The node that reads a file.
    node: str
    is_points: bool = False


SURFACE = Reader(NAME, "meniscus_sequence", "GeometryNodeImportPLY")
OBJ = Reader("Meniscus OBJ Sequence", "meniscus_obj", "GeometryNodeImportOBJ")
POINTS = Reader("Meniscus Points", "meniscus_points", "GeometryNodeImportPLY", is_points=True)
READERS = (SURFACE, OBJ, POINTS)

INPUTS = [
    (
        "Files",
        "NodeSocketString",
        "Path of the files; {:04} stands for the frame number, // for the .blend's folder",
    ),
    ("First", "NodeSocketInt", "First frame of the sequence; earlier frames show it"),
    ("Last", "NodeSocketInt", "Last frame of the sequence; later frames show it"),
    ("Step", "NodeSocketInt", "Distance between frames of the sequence; frames between show the one before"),
    ("Velocity", "NodeSocketBool", "Make `velocity` [m/s] from vx, vy and vz, for motion blur in Cycles"),
    ("Material", "NodeSocketMaterial", "Material of the surface"),
]
INSTANCE_INPUTS = [
    ("Instances", "NodeSocketBool", "Show the object below at every point, in place of a ball. Without Blur Instances they have no motion blur"),
    ("Instance", "NodeSocketObject", "Object of radius 1 about its origin; it is scaled by each point's radius"),
    ("Blur Instances", "NodeSocketBool", "Make the instances one mesh with velocities, for motion blur in Cycles: each needs the memory of its mesh"),
]


def sequence_group(reader: Reader = SURFACE) -> bpy.types.NodeTree:
    """The group of this revision for one kind of file: the .blend's own if it has one, else a new one."""
    for group in bpy.data.node_groups:
        if group.get(reader.stamp) == REVISION and group.is_editable:
            return group
    group = bpy.data.node_groups.new(reader.name, "GeometryNodeTree")
    group[reader.stamp] = REVISION
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    for name, kind, text in INPUTS + (INSTANCE_INPUTS if reader.is_points else []):
        group.interface.new_socket(name, description=text, in_out="INPUT", socket_type=kind)
    Builder(group).build(reader)
    return group


def level_set_group() -> bpy.types.NodeTree:
    """The group that gives the surface of a level set its velocities: the .blend's own if it has one, else a new one."""
    for group in bpy.data.node_groups:
        if group.get(LEVEL_SET_STAMP) == REVISION and group.is_editable:
            return group
    group = bpy.data.node_groups.new(LEVEL_SET_NAME, "GeometryNodeTree")
    group[LEVEL_SET_STAMP] = REVISION
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Volume", description="Volume with the grid `velocity` [m/s]", in_out="INPUT", socket_type="NodeSocketObject")
    Builder(group).build_level_set()
    return group


def is_of_level_set(modifier: bpy.types.Modifier) -> bool:
    return modifier.type == "NODES" and modifier.node_group is not None and LEVEL_SET_STAMP in modifier.node_group


def set_inputs(modifier: bpy.types.NodesModifier, values: dict[str, object]) -> None:
    """Sets group inputs of a modifier by their names."""
    for item in modifier.node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name in values:
            set_input(modifier, item.identifier, values[item.name])


def set_input(modifier: bpy.types.NodesModifier, identifier: str, value: object) -> None:
    """Sets one group input; Blender 5.2 keeps them in `properties`, earlier versions in custom properties."""
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        modifier[identifier] = value


def get_input(modifier: bpy.types.NodesModifier, name: str) -> object:
    """One group input of a modifier by its name; None if the group has none."""
    for item in modifier.node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name:
            if hasattr(modifier, "properties"):
                return getattr(modifier.properties.inputs, item.identifier).value
            return modifier.get(item.identifier)
    return None


class Builder:
    """Adds nodes from left to right, with links from what they need."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group
        self.column = 0

    def node(self, kind: str, *sources: object, label: str = "", row: int = 0, **settings: object):
        """A new node; its inputs in order are linked to sockets, set to plain values, or left where None."""
        node = self.group.nodes.new(kind)
        node.label = label
        node.location = (220 * self.column, -220 * row)
        self.column += 1
        for name, value in settings.items():
            setattr(node, name, value)
        for index, source in enumerate(sources):
            if isinstance(source, bpy.types.NodeSocket):
                self.group.links.new(source, node.inputs[index])
            elif source is not None:
                node.inputs[index].default_value = source
        return node

    def integer(self, operation: str, a: object, b: object, label: str):
        return self.node("FunctionNodeIntegerMath", a, b, operation=operation, label=label, row=1).outputs[0]

    def attribute(self, name: str, row: int):
        return self.node("GeometryNodeInputNamedAttribute", name, data_type="FLOAT", row=row).outputs[0]

    def store(self, geometry: object, name: str, kind: str, value: object):
        """The geometry with a point attribute."""
        node = self.node("GeometryNodeStoreNamedAttribute", data_type=kind, domain="POINT")
        node.inputs["Name"].default_value = name
        self.group.links.new(geometry, node.inputs["Geometry"])
        self.group.links.new(value, node.inputs["Value"])
        return node.outputs[0]

    def choice(self, is_chosen: object, otherwise: object, chosen: object):
        return self.node("GeometryNodeSwitch", is_chosen, otherwise, chosen, input_type="GEOMETRY").outputs[0]

    def build(self, reader: Reader) -> None:
        given = self.node("NodeGroupInput").outputs

        # Sub-frames of motion blur belong to the frame that they surround.
        time = self.node("GeometryNodeInputSceneTime", row=1).outputs["Frame"]
        frame = self.node("FunctionNodeFloatToInt", time, rounding_mode="ROUND", row=1).outputs[0]

        # Outside its range the sequence holds its first and last frame.
        frame = self.integer("MAXIMUM", frame, given["First"], "Not before first")
        frame = self.integer("MINIMUM", frame, given["Last"], "Not after last")

        # Between steps the frame before is held: first + floor((frame - first) / step) * step.
        past = self.integer("SUBTRACT", frame, given["First"], "Since first")
        steps = self.integer("DIVIDE_FLOOR", past, given["Step"], "Whole steps")
        past = self.integer("MULTIPLY", steps, given["Step"], "On the step")
        frame = self.integer("ADD", past, given["First"], "Frame of the file")

        # The frame's file is read; Blender keeps the vertex properties vx, vy, vz as float attributes.
        text = self.node("FunctionNodeFormatString", given["Files"])
        text.format_items.new("INT", "Frame")
        self.group.links.new(frame, text.inputs["Frame"])
        mesh = self.node(reader.node, text.outputs[0]).outputs[0]
        if reader == OBJ:
            mesh = self.node("GeometryNodeRealizeInstances", mesh).outputs[0]

        # Cycles blurs along the point attribute `velocity`.
        parts = [self.attribute(name, 2 + axis) for axis, name in enumerate(("vx", "vy", "vz"))]
        vector = self.node("ShaderNodeCombineXYZ", *parts, row=2).outputs[0]
        mesh = self.choice(given["Velocity"], mesh, self.store(mesh, "velocity", "FLOAT_VECTOR", vector))

        # The surface is smooth; points are balls of their own radius, or instances, which have their own material.
        if reader.is_points:
            self.node("NodeGroupOutput", self.points(given, mesh))
            return
        smooth = self.node("GeometryNodeSetShadeSmooth", mesh, True, True, domain="FACE").outputs[0]
        self.node("NodeGroupOutput", self.material(given, smooth))

    def material(self, given: object, shown: object):
        return self.node("GeometryNodeSetMaterial", shown, True, given["Material"]).outputs[0]

    def points(self, given: object, mesh: object):
        """Points with their radius, or an object at each, scaled by that."""
        radius = self.attribute("radius", 2)
        balls = self.node("GeometryNodeMeshToPoints", mesh, mode="VERTICES")
        self.group.links.new(radius, balls.inputs["Radius"])
        shape = self.node("GeometryNodeObjectInfo", given["Instance"], row=1)
        shape.inputs["As Instance"].default_value = True
        many = self.node("GeometryNodeInstanceOnPoints", balls.outputs[0])
        self.group.links.new(shape.outputs["Geometry"], many.inputs["Instance"])
        self.group.links.new(radius, many.inputs["Scale"])
        # Cycles blurs no instance by its velocity, but a mesh whose vertices have those of their instances.
        real = self.node("GeometryNodeRealizeInstances", many.outputs[0]).outputs[0]
        shown = self.choice(given["Blur Instances"], many.outputs[0], real)
        return self.choice(given["Instances"], self.material(given, balls.outputs[0]), shown)

    def build_level_set(self) -> None:
        """The surface of a level set with the velocities that its volume has at its vertices."""
        given = self.node("NodeGroupInput").outputs
        volume = self.node("GeometryNodeObjectInfo", given["Volume"], transform_space="RELATIVE").outputs["Geometry"]
        grid = self.node("GeometryNodeGetNamedGrid", volume, "velocity", data_type="VECTOR").outputs["Grid"]
        velocity = self.node("GeometryNodeSampleGrid", grid, data_type="VECTOR").outputs[0]
        self.node("NodeGroupOutput", self.store(given["Geometry"], "velocity", "FLOAT_VECTOR", velocity))
