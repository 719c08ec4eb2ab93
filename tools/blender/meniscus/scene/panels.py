# SPDX-License-Identifier: MIT OR Apache-2.0
"""Panels: an object's role in Properties > Physics, the shot in Properties > Scene and in the sidebar of the 3D view."""

import bpy

from .. import reload
from . import operators, roles, sampling, schema, session, settings

SHOWN_MESSAGES = 4


class MENISCUS_PT_object(bpy.types.Panel):
    bl_label = "Meniscus"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "physics"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.object is not None and context.object.type in ("MESH", "CURVE", "SURFACE", "FONT", "META", "EMPTY")

    def draw(self, context: bpy.types.Context) -> None:
        layout, role = self.layout, context.object.meniscus
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(role, "role")
        if role.role == "NONE":
            return
        if len(roles.SHAPES[role.role]) > 1:
            layout.prop(role, "shape")
        if role.shape == "MESH" and role.role != "CLOTH":
            layout.prop(role, "resolution")
        animated = layout.column()
        animated.use_property_decorate = True
        if role.role in ("INFLOW", "OUTFLOW", "SMOKE", "FORCE"):
            animated.prop(role, "is_on")
        if role.role == "FORCE":
            animated.prop(role, "factor")
            layout.prop(role, "kind")
            kind = next(choice for choice in schema.choices("ForceKind") if choice.name == role.kind)
            settings.draw(layout, getattr(role, f"kind_{role.kind}"), role.kind, kind.keys)
        if role.role == "CLOTH":
            self.draw_cloth(context, layout, role)
        if role.role == "REGION":
            layout.prop(role, "region_of")
        if role.role in roles.DEFINITIONS:
            definition, attribute = roles.DEFINITIONS[role.role]
            settings.draw(layout, getattr(role, attribute), definition)

    def draw_cloth(self, context: bpy.types.Context, layout: bpy.types.UILayout, role) -> None:
        layout.prop_search(role, "pins", context.object, "vertex_groups")
        if role.pins:
            layout.prop(role, "pin_stiffness")
            settings.draw(layout, role.pin, "Pin")
        layout.prop(role, "use_liquid")
        if role.use_liquid:
            layout.prop(role, "liquid_friction")
        layout.prop(role, "use_air")
        if role.use_air:
            settings.draw(layout, role.drag, "Drag")
        layout.prop(role, "joint_to")
        if role.joint_to is not None:
            layout.prop_search(role, "joint_points", context.object, "vertex_groups")
            layout.prop_search(role, "joint_other_points", role.joint_to, "vertex_groups")
            settings.draw(layout, role.joint, "Joint")


class ShotPanel:
    """Folder, quality, buttons and progress."""

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        shot, job = scene.meniscus, session.job_of(scene)
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = job is None or not job.is_running
        column.prop(shot, "folder")
        column.row().prop(shot, "quality", expand=True)
        is_running = job is not None and job.is_running
        row = layout.row(align=True)
        row.operator("meniscus.plan", icon="INFO")
        if is_running:
            row.operator("meniscus.pause", icon="PAUSE")
        else:
            row.operator("meniscus.simulate", icon="PLAY")
            if job is not None and job.action in session.RUNS and job.code != 0:
                row.operator("meniscus.resume", icon="FRAME_NEXT")
        sampled = sampling.text_of(scene)
        if sampled is not None:
            layout.progress(factor=sampling.Sampling.current.step.part, type="BAR", text=sampled)
        elif job is not None:
            self.draw_job(layout, job)
        for line in session.plan_of(scene):
            layout.label(text=line)
        row = layout.row(align=True)
        row.operator("meniscus.mesh", icon="MESH_ICOSPHERE")
        row.operator("meniscus.whitewater", icon="OUTLINER_OB_POINTCLOUD")
        row = layout.row(align=True)
        row.operator("meniscus.start_over", icon="FILE_REFRESH")
        row.operator("meniscus.show", icon="HIDE_OFF")
        row.operator("meniscus.write", icon="FILE_TICK")

    def draw_job(self, layout: bpy.types.UILayout, job) -> None:
        if job.is_running:
            layout.progress(factor=job.percent() / 100.0, type="BAR", text=session.status(job))
        else:
            layout.label(text=session.status(job), icon="ERROR" if job.error else "CHECKMARK" if job.code == 0 else "PAUSE")
        column = layout.column(align=True)
        shown = session.shown_of(job)
        if shown:
            column.label(text=shown, icon="HIDE_OFF")
        for text in ([job.error] if job.error else []) + list(job.messages)[-SHOWN_MESSAGES:]:
            column.label(text=text)


class MENISCUS_PT_scene(ShotPanel, bpy.types.Panel):
    bl_label = "Meniscus"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "scene"


class MENISCUS_PT_sidebar(ShotPanel, bpy.types.Panel):
    bl_label = "Meniscus"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Meniscus"


class MENISCUS_PT_imported(bpy.types.Panel):
    """Shots that were imported into the scene."""

    bl_label = "Imported Shots"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Meniscus"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(reload.imports(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        for shown in reload.imports(context.scene).values():
            self.layout.label(text=shown[0][reload.SHOT])
        self.layout.operator("import_scene.meniscus_reload", icon="FILE_REFRESH")


class SettingsPanel(bpy.types.Panel):
    """A part of the scene's settings."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "scene"
    bl_parent_id = "MENISCUS_PT_scene"
    bl_options = {"DEFAULT_CLOSED"}
    definition, attribute = "", ""

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        settings.draw(self.layout, getattr(context.scene.meniscus, self.attribute), self.definition)


class MENISCUS_PT_quality(SettingsPanel):
    bl_label = "Shot"

    def draw(self, context: bpy.types.Context) -> None:
        layout, shot = self.layout, context.scene.meniscus
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("title", "draft", "preview", "threads"):
            layout.prop(shot, name)


class MENISCUS_PT_whitewater(SettingsPanel):
    bl_label = "Whitewater"
    definition, attribute = "WhitewaterParams", "whitewater"

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.meniscus, "use_whitewater", text="")


class MENISCUS_PT_liquid(SettingsPanel):
    bl_label = "Liquid"
    definition, attribute = "LiquidParams", "liquid"

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        row = self.layout.row()
        row.active = context.scene.meniscus.liquid.use_surface_tension
        row.prop(context.scene.meniscus, "use_splash_tension")
        SettingsPanel.draw(self, context)


def settings_panel(label: str, definition: str, attribute: str) -> type:
    return type(f"MENISCUS_PT_{attribute}", (SettingsPanel,), {"bl_label": label, "definition": definition, "attribute": attribute})


PARTS = [("Surface", "SurfaceParams", "surface"), ("Smoke", "SmokeParams", "smoke"), ("Cloth", "SheetsCommon", "sheets"), ("Volumes", "VolumeParams", "volume")]
CLASSES = [
    *operators.CLASSES,
    MENISCUS_PT_object,
    MENISCUS_PT_scene,
    MENISCUS_PT_sidebar,
    MENISCUS_PT_imported,
    MENISCUS_PT_quality,
    MENISCUS_PT_liquid,
    *(settings_panel(*part) for part in PARTS),
    MENISCUS_PT_whitewater,
]
