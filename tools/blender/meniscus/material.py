# SPDX-License-Identifier: MIT OR Apache-2.0
"""How materials are found again, and those of liquids: `Water`, `Honey`, `Liquids` of several colours, and white `Foam`."""

import bpy

from .nodes import COLOUR

NAME = "Water"
STAMP = "meniscus_water"
IOR = 1.33
# A path of d metres keeps exp(-density (1 - colour) d) of red, green and blue. Pure water absorbs far less,
# but a tank of a metre or two would then look like glass; at twice the density it would hide what is behind.
DEPTH_COLOUR = (0.22, 0.68, 0.82, 1.0)
DEPTH_DENSITY = 1.0
# Without caustics glass throws a black shadow; shadow rays pass with this colour instead.
SHADOW_COLOUR = (0.80, 0.90, 0.94, 1.0)

HONEY_NAME, HONEY_STAMP = "Honey", "meniscus_honey"
HONEY_IOR, HONEY_ROUGHNESS = 1.49, 0.03
# Blue light is gone after millimetres, green after centimetres: thin threads are yellow, a jar is amber.
HONEY_COLOUR, HONEY_DENSITY = (0.97, 0.74, 0.10, 1.0), 60.0
HONEY_SHADOW = (0.90, 0.55, 0.15, 1.0)

LIQUIDS_NAME, LIQUIDS_STAMP = "Liquids", "meniscus_vertex_colours"
# Like ink in milk: light that enters leaves again nearby.
LIQUIDS_ROUGHNESS, LIQUIDS_COAT = 0.12, 0.5

FOAM_NAME, FOAM_STAMP = "Foam", "meniscus_foam"
# Light that many small drops and bubbles scatter is nearly that of snow.
FOAM_COLOUR = (0.88, 0.91, 0.93, 1.0)

TRACERS_NAME, TRACERS_STAMP = "Tracers", "meniscus_tracers"
TRACERS_COLOUR = (0.55, 0.56, 0.58, 1.0)


def own(name: str, stamp: str) -> tuple[bpy.types.Material, bool]:
    """The file's own material that an earlier import stamped, else a new one with nodes; and whether it is new."""
    for material in bpy.data.materials:
        if material.get(stamp) and material.is_editable:
            return material, False
    material = bpy.data.materials.new(name)
    material[stamp] = True
    material.use_nodes = True
    # Next to an active volume Blender gives a new material the nodes of one.
    nodes = material.node_tree.nodes
    nodes.clear()
    surface, output = nodes.new("ShaderNodeBsdfPrincipled"), nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    material.node_tree.links.new(surface.outputs[0], output.inputs["Surface"])
    return material, True


def principled(material: bpy.types.Material) -> bpy.types.Node:
    return next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")


def water() -> bpy.types.Material:
    """The file's own Water that an earlier import made, else a new one."""
    material, is_new = own(NAME, STAMP)
    if is_new:
        material.diffuse_color = (0.45, 0.75, 0.9, 0.5)
        refract(material, IOR, 0.0, SHADOW_COLOUR, DEPTH_COLOUR, DEPTH_DENSITY)
    return material


def honey() -> bpy.types.Material:
    """The file's own Honey that an earlier import made, else a new one: thick, amber, and darker with depth."""
    material, is_new = own(HONEY_NAME, HONEY_STAMP)
    if is_new:
        material.diffuse_color = (0.85, 0.5, 0.08, 0.8)
        refract(material, HONEY_IOR, HONEY_ROUGHNESS, HONEY_SHADOW, HONEY_COLOUR, HONEY_DENSITY)
    return material


def refract(
    material: bpy.types.Material, ior: float, roughness: float, shadow: tuple[float, ...], colour: tuple[float, ...], density: float
) -> None:
    """Makes a material refract, absorb with depth, and let light through to what is behind."""
    material.use_raytrace_refraction = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()

    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    surface.inputs["IOR"].default_value = ior
    surface.inputs["Transmission Weight"].default_value = 1.0
    clear = nodes.new("ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = shadow
    path = nodes.new("ShaderNodeLightPath")
    mix = nodes.new("ShaderNodeMixShader")
    depth = nodes.new("ShaderNodeVolumeAbsorption")
    depth.inputs["Color"].default_value = colour
    depth.inputs["Density"].default_value = density
    output = nodes.new("ShaderNodeOutputMaterial")

    links.new(path.outputs["Is Shadow Ray"], mix.inputs[0])
    links.new(surface.outputs[0], mix.inputs[1])
    links.new(clear.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    links.new(depth.outputs[0], output.inputs["Volume"])
    for node, place in ((surface, (0, 0)), (clear, (0, 380)), (path, (0, 720)), (mix, (320, 200))):
        node.location = place
    depth.location, output.location = (320, -100), (540, 100)


def liquids() -> bpy.types.Material:
    """The file's own Liquids that an earlier import made, else a new one: opaque, in the colour of each vertex."""
    material, is_new = own(LIQUIDS_NAME, LIQUIDS_STAMP)
    if is_new:
        nodes, links = material.node_tree.nodes, material.node_tree.links
        surface = principled(material)
        surface.inputs["Roughness"].default_value = LIQUIDS_ROUGHNESS
        surface.inputs["IOR"].default_value = IOR
        surface.inputs["Coat Weight"].default_value = LIQUIDS_COAT
        colour = nodes.new("ShaderNodeAttribute")
        colour.attribute_name = COLOUR
        colour.location = (-320, 100)
        links.new(colour.outputs["Color"], surface.inputs["Base Color"])
    return material


def foam() -> bpy.types.Material:
    """The file's own Foam that an earlier import made, else a new one."""
    material, is_new = own(FOAM_NAME, FOAM_STAMP)
    if is_new:
        material.diffuse_color = FOAM_COLOUR
        surface = principled(material)
        surface.inputs["Base Color"].default_value = FOAM_COLOUR
        surface.inputs["Roughness"].default_value = 0.8
    return material


def tracers() -> bpy.types.Material:
    """The file's own Tracers that an earlier import made, else a new one: grains of smoke as balls."""
    material, is_new = own(TRACERS_NAME, TRACERS_STAMP)
    if is_new:
        material.diffuse_color = TRACERS_COLOUR
        surface = principled(material)
        surface.inputs["Base Color"].default_value = TRACERS_COLOUR
        surface.inputs["Roughness"].default_value = 1.0
    return material
