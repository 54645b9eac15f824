"""USD stage to the `Scene` that a frame needs: meshes, materials, lights and camera as plain data."""

from fexel.scene.camera import image_height, list_cameras
from fexel.scene.model import Camera, Draw, Light, Material, Mesh, Scene, Texture, TextureInput
from fexel.scene.reader import COMPLEXITIES, SceneReader

__all__ = [
    "COMPLEXITIES",
    "Camera",
    "Draw",
    "Light",
    "Material",
    "Mesh",
    "Scene",
    "SceneReader",
    "Texture",
    "TextureInput",
    "image_height",
    "list_cameras",
]
