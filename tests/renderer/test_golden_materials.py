"""One picture of what the shading tests cannot see: highlights, terminators, coats, side by side.

Rows: dielectric, metal, clearcoat over a rough red, specular workflow. Columns: roughness 0.05 to 1; the last is
translucent. A sphere light at the upper left, a distant light from the right, a dim blue dome.
"""

from __future__ import annotations

import numpy as np
from scenes import camera, draw, light, scene, settings, sphere, translation

ROWS = (
    {"diffuseColor": (0.6, 0.6, 0.6)},
    {"diffuseColor": (0.9, 0.6, 0.3), "metallic": 1.0},
    {"diffuseColor": (0.5, 0.05, 0.03), "clearcoat": 1.0, "clearcoatRoughness": 0.1},
    {"diffuseColor": (0.05, 0.2, 0.1), "useSpecularWorkflow": 1.0, "specularColor": (0.4, 0.3, 0.5)},
)
ROUGHNESS = (0.05, 0.2, 0.4, 0.7, 1.0)


def test_materials_look_as_they_did(renderer, golden):
    ball = sphere(0.45, rings=48)
    draws = [
        draw(ball, translation(column - 2.5, 1.5 - row, 0), roughness=roughness, **material)
        for row, material in enumerate(ROWS)
        for column, roughness in enumerate(ROUGHNESS)
    ]
    draws += [draw(ball, translation(2.5, 1.5 - row, 0), opacity=0.4, **material) for row, material in enumerate(ROWS)]
    from_right = np.array([[0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0.5, 0], [0, 0, 0, 1.0]])
    lamps = [
        light("sphere", (60, 60, 60), translation(-4, 4, 4), radius=0.7),
        light("distant", (0.6, 0.5, 0.4), from_right, angle=1.0, normalize=True),
        light("dome", (0.05, 0.08, 0.15)),
    ]
    view = camera((0, 0, 8), half_height=0.26, aspect=1.5)
    image = renderer.draw(scene(*draws, lights=lamps, view=view), settings(192, 128))["color"]
    # Another version of the rasteriser may place a sample on the other side of an edge: few pixels, by a quarter.
    golden("materials", image, mean=0.005, off=0.01, limit=0.4)
