# SPDX-License-Identifier: MIT OR Apache-2.0
"""Renders meshes in matte grey with Cycles on the CPU, to see their shape and nothing else.

    python tools/blender/clay.py surface.ply -o picture.png [--turn 30] [--tilt 35] [--zoom 1] [--size 360x270]

The interpreter needs bpy (4.5 to 5.2) and numpy. The camera is orthographic and looks at the middle of the mesh; --zoom shows a part
of it that much larger. Several meshes with as many pictures are rendered one after the other, all from the place of the first.
"""

import argparse
import sys
from math import cos, radians, sin
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector


def camera(mesh: bpy.types.Mesh, options: argparse.Namespace) -> None:
    """Looks at the middle of the mesh from outside of it."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    low, high = np.quantile(points, (0.001, 0.999), axis=0)
    size = float(np.linalg.norm(high - low))
    turn, tilt = radians(options.turn), radians(options.tilt)
    away = Vector((cos(tilt) * sin(turn), -cos(tilt) * cos(turn), sin(tilt)))
    data = bpy.data.cameras.new("camera")
    data.type, data.ortho_scale, data.clip_end = "ORTHO", size / options.zoom, 10 * size
    seen = bpy.data.objects.new("camera", data)
    seen.location = Vector((low + high) / 2) + away * 2 * size
    seen.rotation_euler = (-away).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(seen)
    bpy.context.scene.camera = seen


def studio(options: argparse.Namespace) -> bpy.types.Material:
    """A sun from the side, a pale sky, and the clay."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", options.samples
    scene.render.resolution_x, scene.render.resolution_y = map(int, options.size.split("x"))
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.color_mode, scene.render.image_settings.compression = "BW", 100
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.35, 0.35, 0.35, 1)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 3.0, radians(2)
    lamp = bpy.data.objects.new("sun", sun)
    # Low and next to the camera: bumps cast shadows.
    lamp.rotation_euler = (radians(62), 0, radians(options.turn + 75))
    scene.collection.objects.link(lamp)
    clay = bpy.data.materials.new("clay")
    clay.use_nodes = True
    shader = clay.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.6, 0.6, 0.6, 1)
    shader.inputs["Roughness"].default_value = 0.8
    return clay


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("-o", "--output", action="append", required=True, type=Path, help="a picture for every mesh")
    parser.add_argument("--turn", type=float, default=30.0, help="of the camera about Z [degrees]")
    parser.add_argument("--tilt", type=float, default=35.0, help="of the camera over the horizon [degrees]")
    parser.add_argument("--zoom", type=float, default=1.0)
    parser.add_argument("--size", default="360x270")
    parser.add_argument("--samples", type=int, default=32)
    options = parser.parse_args()
    if len(options.meshes) != len(options.output):
        parser.error(f"{len(options.meshes)} meshes and {len(options.output)} pictures; expected as many")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    clay = studio(options)
    for mesh, picture in zip(options.meshes, options.output):
        bpy.ops.wm.ply_import(filepath=str(mesh.resolve()))
        shown = bpy.context.object
        shown.data.materials.append(clay)
        shown.data.shade_smooth()
        if bpy.context.scene.camera is None:
            camera(shown.data, options)
        bpy.context.scene.render.filepath = str(picture.resolve())
        bpy.ops.render.render(write_still=True)
        bpy.data.objects.remove(shown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
