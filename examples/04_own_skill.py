"""Write a skill: trace a square with rounded corners, and use it as a leaf.

`PathSkill` follows a tool path completely or not at all. The base class `Skill` requires only a
generator `run`, in which every `yield` ends a tick; see `07_blackboard_and_outputs.py`.

Prints::

    square: SUCCESS, 0.036... mm RMS from the plan in 2.46 s
    <text>:8:27: error: square: side: must be at most 0.5 m, not 12
        8 |     tree: {square: {side: 12, speed: 0.5}}
          |                           ^^
          = in meters: 0.012, if 12 mm are meant
"""

import numpy as np

import bt_dualarm as bt


class Square(bt.PathSkill):
    """Trace a square with the tool, from one of its corners and back there."""

    class Ports(bt.PortModel):
        plane: bt.Plane = bt.port("yz", "plane of the square")
        side: float = bt.port(0.1, "length of a side", unit="m", ge=0.02, le=0.5)
        blend: float = bt.port(0.01, "how near to a corner it may be cut", unit="m", gt=0, le=0.1)
        speed: bt.Speed = bt.PathSkill.SPEED
        tolerance: float = bt.PathSkill.TOLERANCE

    failures = bt.PathSkill.failures
    example = "square: {side: 0.1}"
    ports: Ports

    def run(self) -> bt.Ticks:
        """Plan from where the tool is, follow the path; `along` measures and verifies."""
        start = self.arm.commanded_tool_pose
        first, second = (self.ports.side * np.asarray(axis) for axis in self.ports.plane.axes)
        steps = (0 * first, first, first + second, second, 0 * first)
        corners = [bt.Pose(start.position + step, start.quaternion) for step in steps]
        yield from self.along(bt.blended_path(corners, self.ports.blend))


TREE = """
bt_dualarm: 1
world: {scene: empty, reality: lab}
arms:
  arm1:
    robot: ur5
    posture: present
    tree: {square: {side: 0.12, speed: 0.5}}
"""

leaf = bt.run(TREE, skills=[Square]).arms["arm1"].leaves["square"]
rms_mm, seconds = 1000 * leaf.metrics["path_rms_m"], leaf.metrics["duration_s"]
print(f"square: {leaf.status}, {rms_mm:.4f} mm RMS from the plan in {seconds:.2f} s")

# The declared ports are checked before anything moves.
for problem in bt.check(TREE.replace("0.12", "12"), skills=[Square]):
    print(problem)
