# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of results that the scene shows, inside Blender: bodies, cloth, smoke, materials, units; and of the panels.

run.py starts each stage in a process of its own.
"""

import json
import struct
from pathlib import Path

import bpy
import numpy as np
from mathutils import Quaternion

import harness
import ply
from harness import check
from kinds import cloud, read_points
from presets import add
from scenes import empty, scene_module, sequence_input, wait, water

UNIT = 0.5


def result(scene: bpy.types.Scene, key: str) -> bpy.types.Object | None:
    return next((each for each in scene.objects if each.get("meniscus_output") == key), None)


def evaluated_points(shown: bpy.types.Object, frame: int) -> np.ndarray:
    """World places of an object's vertices in a frame [scene units]."""
    bpy.context.scene.frame_set(frame)
    each = shown.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([each.matrix_world @ vertex.co for vertex in each.data.vertices])


def stage_bodies(folder: Path) -> None:
    """Bodies are found by their names, where the simulation moved them, with their own materials, in the scene's units."""
    scene = empty(folder)
    scene.unit_settings.scale_length = UNIT
    # Blender's gravity of 9.81 units is half of Earth's at this unit.
    scene.gravity = (0.0, 0.0, -9.81 / UNIT)
    for kind in ("tank", "pool"):
        add(kind)
    scene.meniscus.liquid.spacing, scene.frame_end = 0.16, 6
    names = ("Zulu", "Alfa", "Mike")
    for index, name in enumerate(names):
        made = add("body")
        made.name = name
        # Names and shapes are in another order than their addition.
        made.location = (-1.2 + 1.2 * index, 0.0, 1.2 + 0.1 * index)
        made.rotation_euler, made.scale = (0.1 * index, 0.3, 0.0), (1.0, 1.0 + 0.2 * index, 1.0)
        made.data.materials.append(bpy.data.materials.new(f"Paint {name}"))
        made.meniscus.body.density = 500.0
    glass_tank()
    start = {name: evaluated_points(bpy.data.objects[name], 1) for name in names}
    bpy.ops.meniscus.simulate()
    job, _ = wait(scene)
    check(job.code == 0 and not job.error, "the job ends with its result", (job.code, job.error))
    for name in names:
        shown = result(scene, f"body:{name}")
        check(shown is not None and shown.data.materials[0].name == f"Paint {name}", f"{name} has a result with its own material")
        if shown is None:
            continue
        check(np.abs(evaluated_points(shown, 1) - start[name]).max() < 1e-4, f"{name} starts where it was placed")
        motion = json.loads((folder / "meniscus" / "draft" / "collider" / f"{name}.json").read_text())
        table, _ = ply.read(folder / "meniscus" / "draft" / "collider" / f"{name}.ply")
        rest = np.stack([table[axis] for axis in "xyz"], axis=1)
        pose = motion["poses"][5]
        world = (rest @ np.array(Quaternion(pose[3:]).to_matrix()).T + pose[:3]) / UNIT
        found = evaluated_points(shown, 6)
        distance = max(np.abs(world - point).max(axis=1).min() for point in found)
        check(distance < 1e-3, f"{name} is where the engine has it in the last frame", distance)
        fallen = float((start[name] - found)[:, 2].mean())
        check(0.3 < fallen * UNIT / (0.5 * 9.81 * (5.0 / 24.0) ** 2) < 1.3, f"{name} falls in metres", fallen)
        source = bpy.data.objects[name]
        check(source.hide_get() and source.hide_render, f"{name} itself is put aside")
    check(result(scene, "tank:tank") is not None, "a tank of glass has its walls as a result")
    low, high = (np.array(points) for points in (evaluated_points(water(scene), 1).min(0), evaluated_points(water(scene), 1).max(0)))
    check(np.allclose(high[:2] - low[:2], (4.0, 2.0), atol=0.3), "the water has the size of the pool in the scene's units", (low, high))
    count = len(scene.objects)
    written = (folder / "meniscus" / "scene.toml").read_bytes()
    changed = result(scene, "body:Mike")
    place = evaluated_points(changed, 6)
    changed.constraints.new("LIMIT_SCALE")
    changed.modifiers.new("Bevel", "BEVEL").show_viewport = False
    changed.data.materials[0] = bpy.data.materials.new("Gold")
    bpy.ops.meniscus.simulate(wait=True)
    check(len(scene.objects) == count, "a second run makes no second results", (count, len(scene.objects)))
    check((folder / "meniscus" / "scene.toml").read_bytes() == written, "results do not change the preset")
    is_same = result(scene, "body:Mike") == changed
    kept = is_same and len(changed.constraints) == 1 and "Bevel" in changed.modifiers and changed.data.materials[0].name == "Gold"
    check(kept, "a second run keeps the artist's constraints, modifiers and materials", is_same)
    check(kept and np.abs(evaluated_points(changed, 6) - place).max() < 1e-5, "the result is where it was")


def stage_cloth(folder: Path) -> None:
    """Cloth keeps its mesh, UV map and material and follows its point cache; smoke becomes a volume."""
    scene = empty(folder)
    scene.frame_end = 5
    cloth = add("cloth")
    cloth.data.uv_layers.new(name="Cut")
    cloth.data.materials.append(bpy.data.materials.new("Silk"))
    cloth.location.x = 0.3
    add("collider")
    smoke = add("smoke")
    smoke.location.x = 2.0
    smoke.meniscus.smoke.use_velocity, smoke.meniscus.smoke.velocity = True, (0.0, 0.0, 0.5)
    scene.meniscus.smoke.spacing = 0.12
    bpy.ops.meniscus.simulate(wait=True)
    shown = result(scene, "sheet:Cloth")
    check(shown is not None and "Cut" in shown.data.uv_layers and shown.data.materials[0].name == "Silk", "cloth has its UV map and material")
    content = (folder / "meniscus" / "draft" / "sheet" / "Cloth.pc2").read_bytes()
    count, samples = struct.unpack("<i", content[16:20])[0], struct.unpack("<i", content[28:32])[0]
    places = np.frombuffer(content[32:], "<f4").reshape(samples, count, 3)
    check(np.abs(evaluated_points(shown, 5) - places[4]).max() < 1e-5, "cloth follows its point cache")
    check(places[4][:, 2].mean() < places[0][:, 2].mean() - 0.05, "it falls")
    shown.modifiers.new("Thickness", "SOLIDIFY").show_viewport = False
    scene.frame_set(5)
    bpy.ops.meniscus.show()
    again = result(scene, "sheet:Cloth")
    kept = again == shown and [each.type for each in shown.modifiers] == ["MESH_CACHE", "SOLIDIFY"]
    check(kept and np.abs(evaluated_points(shown, 5) - places[4]).max() < 1e-5, "cloth that is shown again keeps its modifiers", kept)
    volume = result(scene, "volume:smoke")
    check(volume is not None and volume.type == "VOLUME" and volume.data.is_sequence, "smoke is a sequence of volumes")
    check(cloth.meniscus.role == "CLOTH" and cloth.hide_render, "the cloth itself is put aside")
    check_renamed(folder)


def check_renamed(folder: Path) -> None:
    """Renaming an object between the preset and its result, or between two presets, loses no look and no result."""
    cloth = bpy.data.objects["Cloth"]
    cloth.name = "Sail"
    copy = cloth.copy()
    copy.data = cloth.data.copy()
    copy.data.materials[0] = bpy.data.materials.new("Paper")
    copy.name, copy.location.x = "Cloth", 4.0
    bpy.context.collection.objects.link(copy)
    for name in ("in this session", "after the file was saved and opened"):
        bpy.data.objects.remove(result(bpy.context.scene, "sheet:Cloth"))
        bpy.ops.meniscus.show()
        shown = result(bpy.context.scene, "sheet:Cloth")
        materials = [each.name for each in shown.data.materials]
        check(materials == ["Silk"] and "Cut" in shown.data.uv_layers, f"a result finds its renamed object {name}, not a copy with its name", materials)
        check(abs(evaluated_points(shown, 1)[:, 0].mean() - 0.3) < 1e-4, f"it is at its place {name}")
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    scene = bpy.context.scene
    bpy.data.objects.remove(bpy.data.objects["Cloth"])
    for each in [each for each in scene.objects if each.meniscus.role == "SMOKE"]:
        each.meniscus.role = "NONE"
    shown = result(scene, "sheet:Cloth")
    shown.name = "My Sail"
    shown.data.materials[0] = bpy.data.materials.new("Gold")
    bpy.ops.meniscus.start_over(wait=True)
    again = result(scene, "sheet:Sail")
    check(again == shown and again.data.materials[0].name == "Gold", "the result of a renamed object stays the same object", again and again.name)
    check(result(scene, "sheet:Cloth") is None, "it has no second result")


def arrivals(scene: bpy.types.Scene, until) -> list[str]:
    """Runs the scene's job until enough has arrived, and pauses it; what the panel showed last."""
    session = scene_module("session")
    session.ARRIVAL_SECONDS, lines, reached = 0.0, [], []
    bpy.ops.meniscus.simulate()

    def look(_job) -> bool:
        lines[:] = [line for line in drawn(scene_module("panels").MENISCUS_PT_sidebar) if line.startswith("Shown")] or lines
        reached[:] = [until()]
        return reached[0]

    job, _ = wait(scene, look)
    check(job.is_running and reached == [True], "all of it arrives while the job runs", (job.code, job.error, list(job.messages)))
    bpy.ops.meniscus.pause()
    wait(scene)
    return lines


def stage_arrivals(folder: Path) -> None:
    """Smoke, cloth, bodies, whitewater, mist, droplets and tanks are shown while they are simulated, and the panel lists them."""
    scene = empty(folder / "smoke and cloth")
    scene.frame_end = 2000
    cloth = add("cloth")
    cloth.data.materials.append(bpy.data.materials.new("Silk"))
    smoke = add("smoke")
    smoke.location.x = 2.0
    scene.meniscus.smoke.spacing = 0.1
    # No frame yet: the last that has arrived is shown.
    scene.frame_set(1999)
    seen = []

    def lowered() -> bool:
        shown, volume = result(scene, "sheet:Cloth"), result(scene, "volume:smoke")
        if shown is None or volume is None:
            return False
        place = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices[820].co.z
        seen.append((volume.data.frame_duration, -place))
        return seen[-1][0] > seen[0][0] and seen[-1][1] > seen[0][1] + 1e-4

    lines = arrivals(scene, lowered)
    check(len(seen) > 1 and all(one[0] <= other[0] and one[1] <= other[1] + 1e-6 for one, other in zip(seen, seen[1:])), "the smoke grows and the cloth falls as frames arrive", seen[-3:])
    shown = result(scene, "sheet:Cloth")
    check(shown.data.materials[0].name == "Silk" and cloth.hide_get() and scene.frame_current == 1999, "cloth arrives as the artist's own mesh", scene.frame_current)
    check(any("Smoke" in line and "Cloth" in line for line in lines), "the panel lists smoke and cloth", lines)
    check_bodies_arrive(folder / "bodies and whitewater")
    check_droplets_arrive(folder / "droplets and tanks")


def check_bodies_arrive(folder: Path) -> None:
    scene = empty(folder)
    for kind in ("tank", "pool", "body"):
        add(kind)
    glass_tank()
    scene.meniscus.liquid.spacing, scene.frame_end, scene.meniscus.use_whitewater = 0.03, 2000, True
    seen = []

    def fallen() -> bool:
        body, foam = result(scene, "body:Body"), result(scene, "points:whitewater")
        if body is None or foam is None or body.animation_data is None or body.animation_data.action is None:
            return False
        seen.append((body.animation_data.action.frame_range[1], sequence_input(foam, "Last")))
        return seen[-1][0] > seen[0][0]

    lines = arrivals(scene, fallen)
    check(len(seen) > 1 and len(bpy.data.actions) == 1, "a body has more keyframes at each look, and one action", (seen[-2:], len(bpy.data.actions)))
    text = lines[-1] if lines else ""
    check(all(name in text for name in ("Surface", "Body", "Whitewater")), "the panel lists surface, bodies and whitewater", lines)
    check(result(scene, "tank:tank") is not None, "a tank of glass at rest is shown")
    check(len([each for each in scene.objects if each.get("meniscus_output")]) == 4, "each has one object", [each.name for each in scene.objects])


def glass_tank() -> bpy.types.Object:
    tank = bpy.data.objects["Tank"]
    tank.meniscus.collider.use_look, tank.meniscus.collider.look = True, "glass"
    return tank


def check_droplets_arrive(folder: Path) -> None:
    scene = empty(folder)
    for kind in ("tank", "drop"):
        add(kind)
    tank = glass_tank()
    for frame, place in ((1, 0.0), (20, 0.1)):
        tank.location.x = place
        tank.keyframe_insert("location", frame=frame)
    scene.meniscus.liquid.spacing, scene.frame_end = 0.02, 2000
    components = scene.meniscus.surface
    scene.meniscus.use_whitewater, scene.meniscus.whitewater.use_files, scene.meniscus.whitewater.files = True, True, {"vdb"}
    # All of the drop are droplets.
    components.use_components, components.components.smallest = True, 1e6
    seen = []

    def arrived() -> bool:
        drops, walls = result(scene, "points:liquid_points"), result(scene, "tank:tank")
        mist = result(scene, "volume:whitewater")
        if mist is None or drops is None or walls is None or walls.animation_data is None or walls.animation_data.action is None:
            return False
        seen.append(sequence_input(drops, "Last"))
        return seen[-1] > seen[0] and mist.data.frame_duration > 1 and walls.animation_data.action.frame_range[1] > 10

    lines = arrivals(scene, arrived)
    check(len(seen) > 1, "droplets have more frames at each look", seen[-2:])
    text = lines[-1] if lines else ""
    check("Droplets" in text and "Mist" in text and "tank" not in text, "the panel lists them, but no tank", lines)
    scene.frame_set(2)
    drops = cloud(result(scene, "points:liquid_points"))
    table = read_points(folder / "meniscus" / "draft" / "mesh" / "liquid_points_0002.ply")
    check(len(table["x"]) > 0 and np.array_equal(drops["radius"], table["radius"]), "droplets are those of their file", len(drops["radius"]))


class Recorder:
    """Stands in for a layout: panels are drawn without a window, and every property, operator and icon has to exist."""

    icons = set(bpy.types.UILayout.bl_rna.functions["prop"].parameters["icon"].enum_items.keys())

    def __init__(self, drawn: list[str]) -> None:
        self.__dict__["drawn"] = drawn

    def __setattr__(self, name: str, value: object) -> None:
        if name not in bpy.types.UILayout.bl_rna.properties:
            raise AttributeError(name)

    def prop(self, data, name: str, text: str = "", icon: str = "NONE", expand: bool = False) -> None:
        data.bl_rna.properties[name]
        getattr(data, name)
        self.add(name, icon)

    def prop_search(self, data, name: str, source, collection: str) -> None:
        getattr(source, collection)
        self.prop(data, name)

    def operator(self, name: str, text: str = "", icon: str = "NONE"):
        module, _, function = name.partition(".")
        getattr(getattr(bpy.ops, module), function).get_rna_type()
        self.add(name, icon)
        return type("Properties", (), {})()

    def label(self, text: str = "", icon: str = "NONE") -> None:
        self.add(text, icon)

    def progress(self, factor: float, type: str, text: str) -> None:
        self.add(text, "NONE")

    def add(self, text: str, icon: str) -> None:
        if icon not in self.icons:
            raise ValueError(icon)
        self.drawn.append(text)

    def row(self, **_options):
        return Recorder(self.drawn)

    column = row

    def panel(self, _name: str, default_closed: bool):
        return Recorder(self.drawn), Recorder(self.drawn)

    def menu(self, name: str, icon: str = "NONE") -> None:
        self.add(getattr(bpy.types, name).bl_label, icon)


def drawn(panel: type, method: str = "draw") -> list[str]:
    found: list[str] = []
    stand_in = type("StandIn", (), {"layout": Recorder(found)})
    for name in ("draw_cloth", "draw_job", "definition", "attribute"):
        if hasattr(panel, name):
            setattr(stand_in, name, getattr(panel, name))
    getattr(panel, method)(stand_in(), bpy.context)
    return found


def stage_panels(folder: Path) -> None:
    """Every panel and menu draws, for every role and kind of force."""
    scene = empty(folder)
    panels, add_module = scene_module("panels"), scene_module("add")
    check(len(drawn(add_module.MENISCUS_MT_add)) == 17, "the menu draws its seventeen entries")
    for kind in add_module.KINDS:
        add(kind)
        found = drawn(panels.MENISCUS_PT_object)
        check(panels.MENISCUS_PT_object.poll(bpy.context) and "role" in found, f"the panel of {kind} draws", found)
    for name in ("uniform", "point", "vortex", "turbulence", "drag"):
        force = bpy.data.objects["Force"]
        bpy.context.view_layer.objects.active = force
        force.meniscus.kind = name
        check("factor" in drawn(panels.MENISCUS_PT_object), f"the panel of the force {name} draws")
    cloth = bpy.data.objects["Cloth"]
    cloth.meniscus.joint_to = bpy.context.view_layer.objects.active = cloth
    found = drawn(panels.MENISCUS_PT_object)
    check({"joint_points", "joint_other_points", "stiffness", "release"} <= set(found), "the panel of cloth has its joint", found)
    settings = [panel for panel in panels.CLASSES if isinstance(panel, type) and issubclass(panel, bpy.types.Panel)]
    for panel in settings:
        if panel is not panels.MENISCUS_PT_object:
            check(bool(drawn(panel)), f"the panel {panel.__name__} draws")
    found = drawn(panels.MENISCUS_PT_scene)
    check("meniscus.simulate" in found and "meniscus.pause" not in found, "without a job there is Simulate", found)
    scene.meniscus.liquid.spacing = 0.2
    for name in ("Body", "Cloth", "Smoke", "Smoke Cloud", "Smoke Ring", "Vortex Tube", "Turbulence", "Force", "Tap", "Glass"):
        bpy.data.objects.remove(bpy.data.objects[name])
    scene.frame_end = 40
    bpy.ops.meniscus.simulate()
    found = drawn(panels.MENISCUS_PT_scene)
    check("meniscus.pause" in found and "meniscus.simulate" not in found, "with a job there is Pause", found)
    bpy.ops.meniscus.pause()
    session = scene_module("session")
    job, _ = wait(scene)
    found = drawn(panels.MENISCUS_PT_sidebar)
    check(job.code == 130 and "meniscus.resume" in found, "after a pause there is Resume", (job.code, found))
    glass = add("collider")
    glass.meniscus.collider.use_look, glass.meniscus.collider.look = True, "glass"
    names = [slot.material.name for slot in glass.material_slots if slot.material]
    check(names == ["Glass"], "a collider of glass without a material gets the material Glass", names)
    check(bool(session.status(job)), "the job has a status")
    check_colours(folder / "colours")


def check_colours(folder: Path) -> None:
    """Surfaces of a fluid with a colour have it while they arrive, at the end, and meshed again."""
    scene = empty(folder)
    for kind in ("tank", "pool", "drop"):
        add(kind)
    scene.meniscus.liquid.spacing, scene.frame_end = 0.08, 200
    drop = next(each for each in scene.objects if each.name.startswith("Drop"))
    drop.meniscus.source.use_color = True
    applied = []

    def replaced() -> bool:
        shown = water(scene)
        if shown is not None and not applied:
            # As Apply does: the next surfaces need another object.
            shown.modifiers.clear()
            shown.select_set(True)
            applied.append(shown.session_uid)
        return shown is not None and shown.session_uid not in applied

    arrivals(scene, replaced)
    check(water(scene).select_get(), "a surface without its modifier is replaced, and selected as it was")
    names = [each.name for each in water(scene).data.materials]
    check(names == ["Liquids"], "surfaces that arrive have colours", names)
    scene.frame_end = 3
    bpy.ops.meniscus.start_over(wait=True)
    for name in ("at the end", "meshed again"):
        mesh = water(scene).evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        check("Col" in mesh.attributes, f"surfaces have colours {name}", list(mesh.attributes.keys()))
        scene.meniscus.surface.voxel = 0.8
        bpy.ops.meniscus.mesh(wait=True)


if __name__ == "__main__":
    harness.run(globals())
