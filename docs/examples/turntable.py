"""Render a turntable of a stage from Python and write it as numbered EXR files with depth.

python docs/examples/turntable.py stages/zipmap_teapot/zipmap_teapot.usda /tmp/turn.####.exr --frames 24
"""

from __future__ import annotations

import argparse

from pxr import Usd, UsdGeom

import fexel
from fexel.renderer.frame_spec import frame_path, parse_frames
from fexel.renderer.output import write_images
from fexel.stage import open_stage


def turn(stage: Usd.Stage, frames: int) -> None:
    """Turn the default prim about the up axis, in the session layer, so that the file is left alone."""
    prim = stage.GetDefaultPrim()
    stage.SetEditTarget(stage.GetSessionLayer())
    xform = UsdGeom.Xformable(prim)
    rotate = xform.AddRotateYOp if UsdGeom.GetStageUpAxis(stage) == "Y" else xform.AddRotateZOp
    operation = rotate(opSuffix="turntable")
    for frame in range(frames):
        operation.Set(360.0 * frame / frames, frame + 1)


def main() -> None:
    """Parse, turn, render, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stage")
    parser.add_argument("image")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--width", type=int, default=320)
    options = parser.parse_args()

    stage = open_stage(options.stage)
    turn(stage, options.frames)
    times = parse_frames(f"1:{options.frames}")
    with fexel.Renderer() as renderer:
        for time in times:
            images = renderer.render(stage, time=time, width=options.width, aovs=("color", "cameraDepth"))
            write_images(frame_path(options.image, time, times), images)


if __name__ == "__main__":
    main()
