"""Pass values between leaves: a skill's output, the blackboard, and a branch that reads it.

Prints::

    high: SUCCESS, leaves that ran: measure_height, compare, circle
    low: SUCCESS, leaves that ran: measure_height, compare, reach_to_pose, circle
"""

import bt_dualarm as bt


class MeasureHeight(bt.Skill):
    """Write the height of the tool, by the encoders, once the arm is at rest."""

    class Ports(bt.PortModel):
        longest: bt.Duration = bt.port(1.0, "how long to wait for rest at most", gt=0, le=60)

    class Outputs(bt.PortModel):
        height: float = bt.port(..., "height of the tool above the world's origin in m")

    failures = {"STILL_MOVING": "the arm did not come to rest in time"}
    example = 'measure_height: {height: "{height}"}'
    ports: Ports

    def run(self) -> bt.Ticks:
        """Yield until the arm is at rest, then write the output."""
        began = self.time
        while not self.arm.controller.at_rest:
            yield  # one tick
            if self.time - began > self.ports.longest:
                raise bt.Failure("STILL_MOVING", "the arm still moves")
        self.output("height", float(self.arm.tool_pose.position[2]))


# `height: "{height}"` at an output names the blackboard key to write; at a port it reads that key.
# The check rejects a key that cannot have been written before it is read.
TREE = """
bt_dualarm: 1
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    posture: POSTURE
    base: {xyz: [0, 0, 0.40]}
    tree:
      sequence:
        - measure_height: {height: "{height}"}
        - selector:
            - compare: {value: "{height}", relation: greater, to: 0.75}
            - reach_to_pose: {offset: {xyz: [0, 0, 0.1]}}
        - circle: {plane: yz, radius: 0.03}
"""

for name, posture in (("high", "home"), ("low", "present")):
    result = bt.run(TREE.replace("POSTURE", posture), skills=[MeasureHeight])
    leaves = result.arms["arm1"].leaves.values()
    print(f"{name}: {result.outcome}, leaves that ran:", ", ".join(leaf.skill for leaf in leaves))
