"""Run by Blender's Python: imports a stage headless, prints its materials as JSON, renders the albedo with Cycles.

usage: python blender_probe.py STAGE ALBEDO.exr [MESH]
"""

import json
import sys

import bpy
from mathutils import Vector

SIZE = 32


def material_report(material):
    nodes = material.node_tree.nodes
    links = [
        {
            "from": link.from_node.bl_idname,
            "image": bpy.path.abspath(link.from_node.image.filepath) if getattr(link.from_node, "image", None) else "",
            "output": link.from_socket.name,
            "to": link.to_node.bl_idname,
            "input": link.to_socket.name,
        }
        for link in material.node_tree.links
    ]
    return {"nodes": [node.bl_idname for node in nodes], "links": links}


def load_images():
    """Force the pixels in: an image that cannot be opened has size (0, 0)."""
    return {bpy.path.abspath(image.filepath): list(image.size) for image in bpy.data.images if image.filepath}


def add_camera(scene, mesh):
    """Orthographic, at `mesh`, or at everything that was imported: from the front, at what lies flat from above.

    The front looks along the stage's -Z (Blender's +Y), from above is along its -Y (Blender's -Z).
    """
    shown = [o for o in scene.objects if o.type == "MESH" and o.name == mesh]
    shown = shown or [o for o in scene.objects if o.type == "MESH"]
    corners = [o.matrix_world @ Vector(c) for o in shown for c in o.bound_box]
    low = Vector(min(c[i] for c in corners) for i in range(3))
    high = Vector(max(c[i] for c in corners) for i in range(3))
    middle, size = (low + high) / 2, high - low
    lies = size.z < 1e-3 * max(size.x, size.y)
    camera = bpy.data.objects.new("View", bpy.data.cameras.new("View"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = max(size.x, size.y if lies else size.z)
    depth = size.z if lies else size.y
    camera.location = (middle.x, middle.y, high.z + depth + 1) if lies else (middle.x, low.y - depth - 1, middle.z)
    camera.rotation_euler = (0.0 if lies else 1.5707963267948966, 0.0, 0.0)
    camera.data.clip_end = 2 * depth + 10.0
    scene.collection.objects.link(camera)
    scene.camera = camera


def render_albedo(scene, path):
    """The diffuse colour pass: what the material reflects, whatever the light."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 2
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.view_layers[0].use_pass_diffuse_color = True
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = "32"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


def main(stage, albedo, mesh=""):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if bpy.ops.wm.usd_import(filepath=stage, import_lights=False, import_cameras=False) != {"FINISHED"}:
        sys.exit("usd_import did not finish")
    scene = bpy.context.scene
    report = {
        "materials": {m.name: material_report(m) for m in bpy.data.materials if m.node_tree},
        "images": load_images(),
        "color_spaces": {
            bpy.path.abspath(image.filepath): image.colorspace_settings.name
            for image in bpy.data.images
            if image.filepath
        },
        "meshes": {
            o.name: [s.material.name for s in o.material_slots if s.material] for o in scene.objects if o.type == "MESH"
        },
    }
    add_camera(scene, mesh)
    render_albedo(scene, albedo)
    print("REPORT " + json.dumps(report))


main(*sys.argv[1:4])
