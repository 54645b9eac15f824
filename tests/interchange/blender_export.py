"""Run by Blender's Python: builds a scene as its users do and exports it to USD.

usage: python blender_export.py IMAGE.png STAGE.usda

A floor to the horizon and two panels that share a mesh and a material, with an image as Base Color; a camera low above.
"""

import sys

import bpy


def material(name, image):
    made = bpy.data.materials.new(name)
    made.use_nodes = True  # what Blender before 5 needs
    nodes = made.node_tree.nodes
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.load(image, check_existing=True)
    made.node_tree.links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def main(image, stage):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=40.0)
    floor = bpy.context.object
    floor.name = "Floor"
    floor.data.materials.append(material("Tiles", image))
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.0, 0.0, 1.0), rotation=(1.5707963, 0.0, 0.0))
    panel = bpy.context.object
    panel.data.materials.append(material("Paint", image))
    other = panel.copy()
    other.location.x = 2.0
    bpy.context.collection.objects.link(other)
    bpy.ops.object.camera_add(location=(0.0, -19.0, 0.7), rotation=(1.5, 0.0, 0.0))
    done = bpy.ops.wm.usd_export(filepath=stage, export_materials=True, export_textures_mode="KEEP")
    if done != {"FINISHED"}:
        sys.exit("usd_export did not finish")


main(*sys.argv[1:3])
