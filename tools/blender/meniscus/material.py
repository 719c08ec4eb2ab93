# SPDX-License-Identifier: MIT OR Apache-2.0
"""How materials are found again; `Water`: clear, refracting, faintly coloured with depth; and `Foam`: white."""

import bpy

NAME = "Water"
STAMP = "meniscus_water"
IOR = 1.33
# A path of d metres keeps exp(-density (1 - colour) d) of red, green and blue. Pure water absorbs far less,
# but a tank of a metre or two would then look like glass; at twice the density it would hide what is behind.
DEPTH_COLOUR = (0.22, 0.68, 0.82, 1.0)
DEPTH_DENSITY = 1.0
# Without caustics glass throws a black shadow; shadow rays pass with this colour instead.
SHADOW_COLOUR = (0.80, 0.90, 0.94, 1.0)

FOAM_NAME, FOAM_STAMP = "Foam", "meniscus_foam"
# Light that many small drops and bubbles scatter is nearly that of snow.
FOAM_COLOUR = (0.88, 0.91, 0.93, 1.0)


def own(name: str, stamp: str) -> tuple[bpy.types.Material, bool]:
    """The file's own material that an earlier import stamped, else a new one with nodes; and whether it is new."""
    for material in bpy.data.materials:
        if material.get(stamp) and material.is_editable:
            return material, False
    material = bpy.data.materials.new(name)
    material[stamp] = True
    material.use_nodes = True
    return material, True


def water() -> bpy.types.Material:
    """The file's own Water that an earlier import made, else a new one."""
    material, is_new = own(NAME, STAMP)
    if not is_new:
        return material
    material.use_raytrace_refraction = True
    material.diffuse_color = (0.45, 0.75, 0.9, 0.5)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()

    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    surface.inputs["Roughness"].default_value = 0.0
    surface.inputs["IOR"].default_value = IOR
    surface.inputs["Transmission Weight"].default_value = 1.0
    clear = nodes.new("ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = SHADOW_COLOUR
    path = nodes.new("ShaderNodeLightPath")
    mix = nodes.new("ShaderNodeMixShader")
    depth = nodes.new("ShaderNodeVolumeAbsorption")
    depth.inputs["Color"].default_value = DEPTH_COLOUR
    depth.inputs["Density"].default_value = DEPTH_DENSITY
    output = nodes.new("ShaderNodeOutputMaterial")

    links.new(path.outputs["Is Shadow Ray"], mix.inputs[0])
    links.new(surface.outputs[0], mix.inputs[1])
    links.new(clear.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    links.new(depth.outputs[0], output.inputs["Volume"])
    for node, place in ((surface, (0, 0)), (clear, (0, 380)), (path, (0, 720)), (mix, (320, 200))):
        node.location = place
    depth.location, output.location = (320, -100), (540, 100)
    return material


def foam() -> bpy.types.Material:
    """The file's own Foam that an earlier import made, else a new one."""
    material, is_new = own(FOAM_NAME, FOAM_STAMP)
    if is_new:
        material.diffuse_color = FOAM_COLOUR
        surface = material.node_tree.nodes["Principled BSDF"]
        surface.inputs["Base Color"].default_value = FOAM_COLOUR
        surface.inputs["Roughness"].default_value = 0.8
    return material
