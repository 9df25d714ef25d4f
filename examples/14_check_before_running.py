"""Check a tree without running it: all errors at once, each with its place and the nearest name.

Prints::

    4 problems
    <text>:6:12: error: there is no robot 'ur55'
        6 |     robot: ur55
          |            ^^^^
          = did you mean 'ur5'?
    ...
    ["did you mean 'ur5'?", "did you mean 'posture'?", 'in meters: 0.08, if 80 mm are meant']
    refused: 4 problems
"""

import bt_dualarm as bt

TREE = """\
bt_dualarm: 1
name: wrong
world: {scene: empty}
arms:
  arm1:
    robot: ur55
    tree:
      sequence:
        - reach_to_pose: {postur: home}
        - circle: {plane: zy, radius: 80}
"""

problems = bt.check(TREE)
print(len(problems), "problems")
for problem in problems:
    print(problem)

# Problems are data, too: for an editor, or a service that takes trees from others.
print([problem.hint for problem in problems if problem.hint])

# Running it raises an error with the same problems before anything moves.
try:
    bt.run(TREE)
except bt.SpecError as error:
    print("refused:", len(error.problems), "problems")
