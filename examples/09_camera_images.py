"""Save images of an arm's camera, with a skill that takes one at the current pose.

Usage: python 09_camera_images.py [FOLDER]

Prints::

    straight.png: 320 x 240 pixels, 9... of them red, camera at [ 0.35 -0.45  0.88]
    aslant.png: 320 x 240 pixels, 18... of them red, camera at [ 0.35 -0.32  0.75]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import bt_dualarm as bt

TREE = """
bt_dualarm: 1
world: {scene: table, reality: lab}
objects:
  cube:
    {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: {xyz: [0.35, -0.45, 0.425]}}
arms:
  arm1:
    robot: panda
    base: {xyz: [0.35, 0, 0.40], rpy: [0, 0, -90]}
    camera: {mount: wrist, resolution: [320, 240], fov: 50}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.35, -0.45, 0.425]}, distance: 0.45}
        - photograph: {name: straight, file: straight.png}
        - look_at:
            {at: {xyz: [0.35, -0.45, 0.425]}, distance: 0.35, direction: [0, -0.4, -1], lean: 5}
        - photograph: {name: aslant, file: aslant.png}
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())


class Photograph(bt.Skill):
    """Save an image of the arm's camera from the current pose."""

    class Ports(bt.PortModel):
        file: str = bt.port(..., "name of the file to write")
        frames: int = bt.port(4, "exposures that are averaged", ge=1, le=100)

    failures = {"NO_CAMERA": "the arm has no camera", "NO_PICTURE": "none came in time"}
    example = "photograph: {file: cube.png}"
    needs_camera = True
    ports: Ports

    def run(self) -> bt.Ticks:
        """Wait for the exposures, then write the file."""
        frame = yield from bt.still_picture(self.arm, self.ports.frames)
        if frame is None:
            raise bt.Failure("NO_PICTURE", "the camera gave no image in time")
        Image.fromarray(frame.image).save(folder / self.ports.file)
        red, green, blue = np.moveaxis(frame.image.astype(int), 2, 0)
        count = int(np.sum(red > 2 * np.maximum(green, blue)))
        where = np.round(frame.pose.position, 2)  # of the camera in the world, by the encoders
        print(f"{self.ports.file}: {frame.width} x {frame.height} pixels, ", end="")
        print(f"{count} of them red, camera at {where}")


result = bt.run(TREE, skills=[Photograph])
if result.outcome is not bt.Outcome.SUCCESS:
    print(result, result.arms["arm1"].leaves)
