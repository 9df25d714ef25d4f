"""Change the world during a run, as a person could, and see how the tree reacts.

Prints::

    0.5 s: the cube is taken away
    1.5 s: the cube is put back elsewhere
    SUCCESS: arm1 holds cube
    1.00 s: FAILURE NOT_THERE: no object 'cube' in the world (there are: none)
    2.02 s: SUCCESS
"""

import numpy as np

import bt_dualarm as bt

TREE = """
bt_dualarm: 1
name: meddled
world: {scene: table, reality: lab}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {xyz: [0.40, -0.45, 0.425]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    tree:
      retry:
        times: 5
        child:
          sequence:
            - wait: 1 s
            - approach_and_attach: {object: cube}
"""

with bt.open(TREE) as run:
    run.step(0.5)
    print(f"{run.time:.1f} s: the cube is taken away")
    before = run.world.object_pose("cube")
    run.world.remove_object("cube")
    run.step(1.0)
    print(f"{run.time:.1f} s: the cube is put back elsewhere")
    beside = bt.Pose(before.position + np.array([-0.1, 0.05, 0.0]), before.quaternion)
    run.world.spawn_object("cube", beside)
    result = run.finish()
    print(f"{result.outcome}: arm1 holds {', '.join(run.arms['arm1'].holds)}")

# A retried leaf has several runs; the result has all of them.
for attempt in result.arms["arm1"].runs:
    if attempt.skill != "wait":
        why = f" {attempt.code}: {attempt.reason}" if attempt.code else ""
        print(f"{attempt.started_s:.2f} s: {attempt.status}{why}")
