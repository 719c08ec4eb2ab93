# SPDX-License-Identifier: MIT OR Apache-2.0
"""The geometry node group that reads a mesh sequence; a saved file needs neither add-on nor scripts.

Scene Time → whole frame → clamped to the sequence → back to the last frame on its step → Format String
→ Import PLY → `velocity` from vx, vy, vz → smooth shading, or for droplets points of their `radius` → material. Cycles takes `velocity` in metres a
second and divides by the scene's frame rate, so the attribute holds the file's values unchanged.
"""

import bpy

NAME, STAMP = "Meniscus Sequence", "meniscus_sequence"
POINTS_NAME, POINTS_STAMP = "Meniscus Points", "meniscus_points"
REVISION = 1
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


def sequence_group(is_points: bool = False) -> bpy.types.NodeTree:
    """The group of this revision for surfaces or for points: the file's own if it has one, else a new one."""
    name, stamp = (POINTS_NAME, POINTS_STAMP) if is_points else (NAME, STAMP)
    for group in bpy.data.node_groups:
        if group.get(stamp) == REVISION and group.is_editable:
            return group
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group[stamp] = REVISION
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    for name, kind, text in INPUTS:
        group.interface.new_socket(name, description=text, in_out="INPUT", socket_type=kind)
    Builder(group).build(is_points)
    return group


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

    def build(self, is_points: bool) -> None:
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
        mesh = self.node("GeometryNodeImportPLY", text.outputs[0]).outputs[0]

        # Cycles blurs along the point attribute `velocity`.
        parts = [self.attribute(name, 2 + axis) for axis, name in enumerate(("vx", "vy", "vz"))]
        vector = self.node("ShaderNodeCombineXYZ", *parts, row=2).outputs[0]
        moving = self.node("GeometryNodeStoreNamedAttribute", data_type="FLOAT_VECTOR", domain="POINT")
        moving.inputs["Name"].default_value = "velocity"
        self.group.links.new(mesh, moving.inputs["Geometry"])
        self.group.links.new(vector, moving.inputs["Value"])
        choice = self.node(
            "GeometryNodeSwitch", given["Velocity"], mesh, moving.outputs[0], input_type="GEOMETRY"
        )

        # The surface is smooth; points are balls of their own radius. Either has its material.
        if is_points:
            radius = self.attribute("radius", 2)
            shown = self.node("GeometryNodeMeshToPoints", choice.outputs[0], mode="VERTICES")
            self.group.links.new(radius, shown.inputs["Radius"])
        else:
            shown = self.node("GeometryNodeSetShadeSmooth", choice.outputs[0], True, True, domain="FACE")
        done = self.node("GeometryNodeSetMaterial", shown.outputs[0], True, given["Material"]).outputs[0]
        self.node("NodeGroupOutput", done)
