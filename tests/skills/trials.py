"""For each skill and each code that it declares, a world in which it fails with that code."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World
from bt_dualarm.testing import after
from tests.plays import Intervention
from tests.skills.scenarios import (
    ABOVE,
    BEAM,
    BESIDE_ANOTHER,
    CABINET,
    CHEST,
    CUBE,
    GIVER,
    GRASP,
    GRIPPING,
    KNOB,
    LOOKING,
    ON_SHELF,
    ON_TABLE,
    PARTNER,
    PICK,
    PRESENTING,
    PULLS,
    SCENARIOS,
    STANDING,
    TAKER,
    TAKES,
    TARGET,
    WALL,
    Scenario,
    Tree,
)


@dataclass(frozen=True)
class Trial:
    """How to make a skill fail.

    Attributes:
        node: The leaf, alone or within other nodes.
        changes: Fields of the skill's scenario that differ here.
        interventions: Changes of the world, with their simulated times in s.
        moves: Whether the arm may have moved when it fails.
    """

    node: Tree
    changes: dict[str, Any] = field(default_factory=dict)
    interventions: tuple[tuple[float, Intervention], ...] = ()
    moves: bool = False

    def scenario(self, skill: str) -> Scenario:
        """The skill's scenario with the changes."""
        return replace(SCENARIOS[skill], **self.changes)


def square(width: float, height: float, **more: Any) -> Tree:
    """Draw a rounded square that stands on its corner, of half extents in m, from its right end."""
    points = [[width, 0.0], [0.0, height], [-width, 0.0], [0.0, -height]]
    return {"draw": {"points": points, **more}}


def lines(points: list[list[float]], **more: Any) -> Tree:
    """Follow lines through points in m, around the tool."""
    return {"follow_path": {"points": points, "scale": 1.0, "start": "around", **more}}


SQUARE = [[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0], [0.0, -0.1]]

WIDE = [
    [0.25 * math.cos(0.1 * math.pi * step), 0.25 * math.sin(0.1 * math.pi * step)]
    for step in range(21)
]
"""A circle, like that of the trial of `circle`."""

FLAT_EIGHT = [
    [0.5 * math.sin(0.1 * math.pi * step), 0.1 * math.sin(0.2 * math.pi * step)]
    for step in range(20)
]
"""A curve along a singularity; other curves of this width end before it."""


def pushes(body: str, newton: float) -> Intervention:
    """Push a body along x from then on."""

    def push(world: World) -> None:
        world.data.xfrc_applied[world.model.body(body).id, 0] = newton

    return push


def slides_in_hand(name: str, meters: float) -> Intervention:
    """Move an object along the pads that hold it, across the tool."""

    def slide(world: World) -> None:
        across = world.arms["arm1"].tool_pose.rotation_matrix[:, 0]
        start = world.pose_address(name)
        world.data.qpos[start : start + 3] += meters * across

    return slide


def steals(name: str) -> Intervention:
    """Move an object far away."""

    def steal(world: World) -> None:
        joint = world.model.body_jntadr[world.object_body(name)]
        world.data.qpos[world.model.jnt_qposadr[joint]] += 2.0

    return steal


def drags(joint: str, newton: float) -> Intervention:
    """Set the dry friction of a joint from then on."""

    def drag(world: World) -> None:
        dof = world.model.jnt_dofadr[world.model.joint(joint).id]
        world.model.dof_frictionloss[dof] = newton

    return drag


def hides(name: str) -> Intervention:
    """Remove an object from the world."""
    return lambda world: world.remove_object(name)


def departs(arm: str) -> Intervention:
    """Remove an arm from the world."""
    return lambda world: world.remove_arm(arm)


def shifts(name: str, meters: float) -> Intervention:
    """Move a fixed object along y."""

    def shift(world: World) -> None:
        world.model.body_pos[world.object_body(name), 1] += meters

    return shift


def shrinks(name: str, sides: slice = slice(None)) -> Intervention:
    """Make an object smaller by a seventh, in all directions or those of `sides`."""

    def shrink(world: World) -> None:
        world.model.geom_size[world.object_geom(name), sides] *= 6 / 7

    return shrink


def jams(world: World) -> None:
    """Block the fingers of an arm."""
    for finger in FINGERS:
        world.model.dof_damping[world.model.joint(f"arm1/{finger}").dofadr] = 1e6


def clogs(world: World) -> None:
    """Make the fingers of an arm creep: at 40 N each of them moves at 10 mm/s."""
    for finger in FINGERS:
        world.model.dof_damping[world.model.joint(f"arm1/{finger}").dofadr] = 4e3


def while_moving(node: Tree) -> Tree:
    """Start a node while another leaf moves the arm."""
    slow = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.05]}, "speed": 0.05}}
    return {"parallel": [slow, {"delay": {"seconds": 0.3, "child": node}}]}


def slab(xyz: list[float], size: list[float], **fields: Any) -> dict[str, Any]:
    """A fixed box."""
    return WALL | {"size": size, "pose": {"xyz": xyz}, "spawned": True} | fields


def knocks(body: str, at: float) -> tuple[tuple[float, Intervention], ...]:
    """Push harder than any arm can resist, for 0.15 s."""
    return (at, pushes(body, 400.0)), (at + 0.15, pushes(body, 0.0))


def cube_that(**fields: Any) -> Tree:
    """The cube on the table with changed fields."""
    return {"cube": ON_TABLE["cube"] | fields}


PLACE: Tree = {"place": {"object": "cube", "at": {"xyz": [0.35, -0.45, 0.425]}}}


SEEING = {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30}


def placed_seen() -> Tree:
    """Place the cube, and then look at it."""
    return {"place": {**PLACE["place"], "look": True}}


def inserted(xyz: list[float], **fields: Any) -> Tree:
    """Insert the cube at a position, whether or not there is a hole."""
    pose = {"xyz": xyz, "rpy": [0, 0, 0]}
    return {"insert": {"object": "cube", "at": pose, "depth": 0.012} | fields}


INSERT = inserted([0.25, -0.45, 0.425])
CARRY_FAR: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.2, 0.6]}, "speed": 0.2}}
AGAIN: Tree = {"regrasp": {"object": "cube"}}
TWO_CUBES = ON_TABLE | {"other": CUBE | {"color": "red", "pose": {"xyz": [0.25, -0.45, 0.425]}}}
SMALL = [[0.05, 0.0], [0.0, 0.05], [-0.05, 0.0], [0.0, -0.05]]
GRASPED = {"before": (GRASP,), "arm": GRIPPING}
RIDER: Tree = {"shape": "box", "size": [0.03, 0.03, 0.03], "mass": 0.05}
LOADED = {"objects": ON_TABLE | {"rider": RIDER | {"pose": {"xyz": [0.40, -0.45, 0.465]}}}}
SUCKING = GRIPPING | {"gripper": "suction_cup"}


def known_late(port: str, value: float) -> tuple[Tree, ...]:
    """A number on the blackboard, so that only the run finds that it is invalid for the gripper."""
    return ({"set": {"key": port, "value": value}},)


TAKE: Tree = {"close_gripper": {"force": 40}}

CLOSED = {
    "before": (TAKE,),
    "objects": SCENARIOS["close_gripper"].objects | {"other": TWO_CUBES["other"]},
}
"""The gripper has closed on an unnamed object; another object is near."""

FAR = {"xyz": [1.15, 0.0, 0.5]}
"""Within the sphere of the nominal reach, but out of the workspace."""

HAND = "arm1/tool0"
REMOVED = ({"remove": {"object": "cube"}},)
CUBE_AWAY = {"cube": CUBE | {"pose": {"xyz": [2.5, 2.5, 0.025]}}}
BESIDE = {"slab": slab([0.68, 0.25, 0.70], [0.4, 0.05, 0.4])}
LOW_CEILING = {"slab": slab([0.45, 0.1, 0.65], [0.6, 0.6, 0.1])}
AT_HOME = {"slab": slab([0.487, 0.109, 0.80], [0.08, 0.08, 0.08])}
MIRRORED: Tree = {"move_joints": {"to": [180, -90, 90, -90, -90, 0]}}
HALVES = {
    name: slab([0.608 * side, -0.608 * side, 1.3], [0.02, 1.5, 2.6], spawned=False)
    | {"pose": {"xyz": [0.608 * side, -0.608 * side, 1.3], "rpy": [0, 0, 45]}}
    for name, side in (("left", -1), ("right", 1))
}
"""Two walls beside the base, so near and so high that no path leads around them."""

CROSSING = {
    "left": slab([0, 0.86, 1.3], [0.02, 1.5, 2.6], spawned=False),
    "right": slab([0, -0.86, 1.3], [0.02, 1.5, 2.6], spawned=False),
}
"""Such walls, rotated so that they do not touch an arm that reaches over the table."""

SPLIT: tuple[Tree, ...] = ({"spawn": {"object": "left"}}, {"spawn": {"object": "right"}})
BLIND = {name: item for name, item in LOOKING.items() if name != "camera"}
PANDA = {"robot": "panda"}

JERKY: Tree = {
    "delay": {"seconds": 2.0, "child": {"move_joints": {"by": {"panda_joint1": 30}, "speed": 1.0}}}
}
STOP_AT_ONCE: Tree = {"delay": {"seconds": 1.0, "child": {"stop": {"longest": 0.03}}}}
CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.3, -0.4, 0.6]}}}
LET_GO: Tree = {"detach": {"object": "cube"}}
TRACK: Tree = {
    "track": {"duration": 3.0, "lost_timeout": 0.5, "wait": 1.0, "reach": 0.1, "reach_timeout": 0.5}
}
LOW_CAMERA = {"mount": "wrist", "resolution": [160, 120], "fov": 60, "fps": 20}
FOLLOWED: Tree = {
    "cube": CUBE | {"pose": {"xyz": [0.45, -0.45, 0.425]}},
    "other": CUBE
    | {
        "size": [0.045] * 3,
        "color": "red",
        "fixed": True,
        "pose": {"xyz": [0.30, -0.45, 0.4225]},
    },
}
BLOCK: Tree = {
    "block": CUBE
    | {
        "size": [0.04, 0.04, 0.21],
        "color": "blue",
        "fixed": True,
        "pose": {"xyz": [0.30, -0.275, 0.505]},
    }
}
LOOK_HOLDING: tuple[Tree, ...] = (
    GRASP,
    {"look_at": {"at": {"xyz": [0.30, -0.45, 0.42]}, "distance": 0.35}},
)
FOLLOW_HOLDING: Tree = {
    "track": {"color": "red", "plane": "xy", "distance": 0.35, "duration": 4.0, "max_error": 0.1}
}
"""The arm then holds the cube at x = 0.30, y = -0.38, 0.19 m above the table."""
LOOK: Tree = {"look_at": {"at": {"xyz": [0.68, 0.11, 0.7]}, "direction": [-1, 0, 0]}}
SCAN: Tree = {"scan": {"object": "cube", "center": [0.4, -0.4, 0.4], "width": 0.2, "depth": 0.2}}
WAIT_FOR: Tree = {"wait_for": {"object": "cube"}}
COUNT: Tree = {"count": {"object": "cube"}}
# The 13th of the images is the last one to arrive for a long time.
BLINDED = LOOKING | {"camera": {"mount": "wrist", "fps": 5, "drop": 0.9}}
LOCATE: Tree = {"locate": {"object": "cube"}}
LARGER = {
    "larger": TARGET["cube"] | {"size": [0.06] * 3, "pose": {"xyz": [5, 5, 5]}, "spawned": False}
}
TOUCHING = {"beside": TARGET["cube"] | {"pose": {"xyz": [0.68, 0.16, 0.70]}}}
GREY = TARGET["cube"] | {"color": "gray"}


def moving(skill: str, node: Tree, at: float, body: str = HAND) -> dict[tuple[str, str], Trial]:
    """Trials for every motion: the arm is knocked, or another leaf moves it."""
    return {
        (skill, "TRACKING_ERROR"): Trial(node, interventions=knocks(body, at), moves=True),
        (skill, "BUSY"): Trial(while_moving(node), moves=True),
    }


def losing(skill: str, ports: Tree) -> dict[tuple[str, str], Trial]:
    """Trials for objects carried along a path: they get thinner, or vanish."""
    carrying = {"objects": ON_TABLE, "scene": "table", "before": (GRASP,), "arm": GRIPPING}
    return {
        (skill, code): Trial({skill: ports}, carrying, ((4.9, intervention),), moves=True)
        for code, intervention in (("SLIPPED", shrinks("cube")), ("DROPPED", steals("cube")))
    }


def carried(**ports: Any) -> Tree:
    """Carry the beam of the skill's scenario, with other ports than in its example."""
    to = {"xyz": [0.05, -0.5, 0.525]}
    return {"carry_together": {"object": "beam", "with": ["arm2"], "to": to, **ports}}


_OPERATED: Tree = {"object": "cabinet", "joint": "slide", "to": 0.15}
OPERATE: Tree = {"operate": _OPERATED}


def cabinet_that(**fields: Any) -> Tree:
    """Objects of the drawer scenario with changed fields of the joint."""
    cabinet = CABINET["cabinet"]
    joint = cabinet["joints"]["slide"] | fields
    return {"cabinet": cabinet | {"joints": {"slide": joint}}}


STIFF_CHEST: Tree = {
    "chest": CHEST["chest"]
    | {"joints": {"hinge": CHEST["chest"]["joints"]["hinge"] | {"friction": 0.6}}}
}
"""A chest that slides before its lid opens."""


def slips(name: str, meters: float) -> Intervention:
    """Move a body on its joint, as if the fingers had slipped along it."""

    def slip(world: World) -> None:
        joint = world.model.body_jntadr[world.object_body(name)]
        world.data.qpos[world.model.jnt_qposadr[joint]] += meters

    return slip


def narrows(name: str, part: str, factor: float) -> Intervention:
    """Scale the thickness of a part of an object."""

    def narrow(world: World) -> None:
        index = [one.name for one in body_of(world.objects[name]).parts].index(part)
        world.model.geom_size[world.object_geoms(name)[index], 1:] *= factor

    return narrow


def beam_that(**fields: Any) -> Tree:
    """Objects of the scenario of `carry_together` with changed fields of the beam."""
    objects = SCENARIOS["carry_together"].objects
    return objects | {"beam": objects["beam"] | fields}


NEVER_CARRIES: Tree = {"carry_together": {"object": "beam", "with": ["arm1"]}}
GIVE: Tree = {"hand_over": {"object": "cube", "to": "arm2"}}
GIVE_BACK: Tree = {"object": "cube", "to": "arm1"}
TAKES_FROM: Tree = {"take_over": {"object": "cube", "from": "arm2"}}
HELD: tuple[Tree, ...] = (GRASP,)
SELF: tuple[Tree, ...] = ({"set": {"key": "who", "value": "arm1"}},)
LOADED_BAR: Tree = {
    "objects": ON_SHELF
    | {
        "cube": ON_SHELF["cube"]
        | {"size": [0.24, 0.05, 0.03], "pose": {"xyz": [0.35, -0.4, 0.215]}},
        "rider": RIDER | {"size": [0.02, 0.02, 0.02], "pose": {"xyz": [0.35, -0.4, 0.24]}},
    }
}
IN_TAKER = CUBE | {"fixed": True, "pose": {"xyz": [0.743, 0, 0.487]}}
"""A cube between the fingers of the taker in its initial posture."""


def partner(arm: Tree, tree: Tree) -> Tree:
    """The other arm of a handover, with another tree."""
    return {"arm2": arm | {"tree": tree}}


def presses(body: str, newton: float) -> Intervention:
    """Push a body downward from then on."""

    def press(world: World) -> None:
        world.data.xfrc_applied[world.model.body(body).id, 2] = -newton

    return press


TRIALS: dict[tuple[str, str], Trial] = {
    ("carry_together", "PARTNER_GONE"): Trial(
        carried(),
        {"others": {"arm2": PARTNER | {"tree": {"selector": ["succeed", NEVER_CARRIES]}}}},
    ),
    ("carry_together", "NOT_THERE"): Trial(
        carried(), {"before": ({"remove": {"object": "beam"}},)}
    ),
    ("carry_together", "INVALID_TARGET"): Trial(carried(), {"objects": beam_that(fixed=True)}),
    ("carry_together", "GRIPPER_FULL"): Trial(
        carried(),
        {
            "before": (TAKE,),
            "objects": beam_that()
            | {"cube": CUBE | {"pose": {"xyz": [-0.063, 0.109, 0.682]}, "fixed": True}},
        },
    ),
    ("carry_together", "TOO_WIDE"): Trial(
        carried(),
        {"objects": beam_that(size=[1.2, 0.12, 0.12], pose={"xyz": [0, -0.45, 0.56]})},
    ),
    ("carry_together", "TOO_HEAVY"): Trial(carried(), {"objects": beam_that(mass=30.0)}),
    ("carry_together", "NO_FACE"): Trial(
        carried(),
        {
            "arm": SCENARIOS["carry_together"].arm | {"gripper": "suction_cup"},
            "objects": beam_that(
                shape="cylinder",
                size=[0.008, 1.2],
                pose={"xyz": [0, -0.45, 0.508], "rpy": [0, 90, 0]},
            ),
        },
    ),
    ("carry_together", "OUT_OF_REACH"): Trial(carried(to={"xyz": [0, -3, 0.6]})),
    ("carry_together", "NOT_GRASPED"): Trial(carried(), interventions=((2.4, jams),), moves=True),
    ("carry_together", "SLIPPED"): Trial(
        carried(), interventions=((5.0, shrinks("beam", slice(1, 3))),), moves=True
    ),
    ("carry_together", "DROPPED"): Trial(
        carried(), interventions=((5.0, steals("beam")),), moves=True
    ),
    ("carry_together", "INTERNAL_FORCE"): Trial(carried(most_internal_force=0.3), moves=True),
    ("carry_together", "NOT_REACHED"): Trial(
        carried(to={"xyz": [0.05, -0.5, 0.522]}, tolerance=0.001), moves=True
    ),
    ("carry_together", "NO_CONTACT"): Trial(carried(to={"xyz": [0.05, -0.5, 0.6]}), moves=True),
    # With joints without friction, the jammed hand rattles on the beam, which the stand bears: by
    # 0.01°, at 0.1 rad/s.
    ("carry_together", "NOT_OPEN"): Trial(
        carried(),
        {"arm": SCENARIOS["carry_together"].arm | {"reality": "lab"}},
        interventions=((9.0, jams),),
        moves=True,
    ),
    ("carry_together", "SPILLED"): Trial(
        carried(),
        {"objects": BEAM | {"rider": RIDER | {"pose": {"xyz": [0, -0.45, 0.565]}}}},
        interventions=((5.0, steals("rider")),),
        moves=True,
    ),
    ("carry_together", "NOT_PLACED"): Trial(
        carried(), interventions=((10.2, slides_in_hand("beam", 0.02)),), moves=True
    ),
    ("spawn", "NOT_SPAWNED"): Trial(
        {"sequence": [{"spawn": {"object": "cube"}}, {"spawn": {"object": "cube"}}]}
    ),
    ("remove", "INVALID_TARGET"): Trial({"remove": {"arm": "arm1"}}),
    ("remove", "NOT_REMOVED"): Trial({"remove": {"object": "cube"}}, {"before": REMOVED}),
    ("stop", "TIMED_OUT"): Trial(
        {
            "parallel": {
                "policy": "any",
                "on_failure": "continue",
                "children": [{"circle": {}}, STOP_AT_ONCE],
            }
        },
        {"arm": PRESENTING},
        moves=True,
    ),
    # Together with another arm
    ("follow_tool", "INVALID_TARGET"): Trial(
        {"follow_tool": {"arm": "arm2", "duration": 1.0}},
        {"before": ({"wait": {"seconds": 0.5}},)},
        interventions=((0.2, departs("arm2")),),
    ),
    ("follow_tool", "UNREACHABLE"): Trial(
        {"follow_tool": {"arm": "arm2", "offset": {"xyz": [0.0, 0.0, -0.1]}, "duration": 1.0}}
    ),
    ("follow_tool", "NOT_FOLLOWING"): Trial(
        {"follow_tool": {"arm": "arm2", "duration": 9.0, "max_error": 1e-4, "lost_timeout": 0.01}},
        {"others": {"arm2": STANDING | {"robot": "panda", "tree": {"sequence": [JERKY]}}}},
        moves=True,
    ),
    ("follow_tool", "PARTNER_GONE"): Trial(
        {"follow_tool": {"arm": "arm2", "duration": 5.0}},
        interventions=((1.0, departs("arm2")),),
        moves=True,
    ),
    ("hold_still", "INVALID_TARGET"): Trial({"hold_still": {"compliance": 0.02, "duration": 1.0}}),
    ("hold_still", "MOVED"): Trial(
        {"hold_still": {"compliance": 0.0005, "max_displacement": 0.005, "duration": 4.0}},
        interventions=((2.0, pushes(HAND, 40.0)), (2.4, pushes(HAND, 0.0))),
        moves=True,
    ),
    ("hold_still", "PARTNER_GONE"): Trial(
        {"hold_still": {"partner": "arm2", "duration": 4.0}},
        {"others": BESIDE_ANOTHER},
        interventions=((1.0, departs("arm2")),),
        moves=True,
    ),
    # Motions of the joints
    ("reach_to_pose", "INVALID_TARGET"): Trial({"reach_to_pose": {"to": {"xyz": [3, 0, 0.5]}}}),
    ("reach_to_pose", "UNREACHABLE"): Trial({"reach_to_pose": {"to": FAR}}),
    ("reach_to_pose", "IN_COLLISION"): Trial(
        {"reach_to_pose": {"to": {"xyz": [0.45, 0.1, 0.65], "rpy": [180, 0, 0]}}},
        {"objects": LOW_CEILING},
    ),
    ("reach_to_pose", "NO_PLAN"): Trial(
        {"reach_to_pose": {"posture": "home"}},
        {"objects": HALVES, "before": (MIRRORED, *SPLIT)},
        moves=True,
    ),
    ("reach_to_pose", "KEEP_VIOLATED"): Trial(
        {"reach_to_pose": {"offset": {"rpy": [30, 0, 0]}, "keep": {"upright": 5}}}
    ),
    ("reach_to_pose", "NOT_REACHED"): Trial(
        {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.05]}, "tolerance": 1e-4}},
        interventions=(
            (0.0, pushes("arm1/forearm_link", 105.0)),
        ),  # just beyond what is compensated
        moves=True,
    ),
    **moving("reach_to_pose", {"reach_to_pose": {"posture": "up"}}, 0.5),
    ("go_home", "IN_COLLISION"): Trial({"go_home": {}}, {"objects": AT_HOME}),
    ("go_home", "NO_PLAN"): Trial(
        {"go_home": {}},
        {"arm": SCENARIOS["reach_to_pose"].arm, "objects": HALVES, "before": (MIRRORED, *SPLIT)},
        moves=True,
    ),
    ("go_home", "SPILLED"): Trial(
        {"go_home": {}},
        GRASPED | LOADED | {"scene": "table"},
        ((3.8, steals("rider")),),
        moves=True,
    ),
    **moving("go_home", {"go_home": {}}, 0.5),
    ("move_joints", "INVALID_TARGET"): Trial({"move_joints": {"by": [10, 20]}}),
    ("move_joints", "JOINT_LIMIT"): Trial({"move_joints": {"by": {"elbow_joint": 300}}}),
    ("move_joints", "IN_COLLISION"): Trial({"move_joints": {"by": {"shoulder_lift_joint": 120}}}),
    **moving("move_joints", {"move_joints": {"by": {"shoulder_lift_joint": 30}}}, 0.4),
    # Motions of the tool
    ("circle", "UNREACHABLE"): Trial({"circle": {"radius": 0.8}}),
    ("circle", "SINGULAR"): Trial({"circle": {"radius": 0.5, "start": "from"}}),
    ("circle", "PATH_BROKEN"): Trial({"circle": {"radius": 0.25, "plane": "xz"}}, {"arm": PANDA}),
    ("circle", "IN_COLLISION"): Trial({"circle": {}}, {"objects": BESIDE}),
    **moving("circle", {"circle": {}}, 1.0),
    ("lissajous", "INVALID_TARGET"): Trial({"lissajous": {"amplitudes": [0.0, 0.0]}}),
    ("lissajous", "UNREACHABLE"): Trial({"lissajous": {"amplitudes": [0.9, 0.1], "phase": 90}}),
    ("lissajous", "SINGULAR"): Trial({"lissajous": {"amplitudes": [0.5, 0.1]}}),
    ("lissajous", "PATH_BROKEN"): Trial(
        {"lissajous": {"amplitudes": [0.2, 0.25], "plane": "xz"}}, {"arm": PANDA}
    ),
    ("lissajous", "IN_COLLISION"): Trial({"lissajous": {}}, {"objects": BESIDE}),
    **moving("lissajous", {"lissajous": {}}, 1.0),
    ("draw", "INVALID_TARGET"): Trial(square(0.1, 0.1, closed=False, repeats=2)),
    ("draw", "UNREACHABLE"): Trial(square(0.7, 0.7)),
    ("draw", "SINGULAR"): Trial({"draw": {"points": FLAT_EIGHT}}),
    ("draw", "PATH_BROKEN"): Trial(square(0.25, 0.25, plane="xz"), {"arm": PANDA}),
    ("draw", "IN_COLLISION"): Trial(square(0.1, 0.1), {"objects": BESIDE}),
    **moving("draw", square(0.1, 0.1), 1.0),
    ("follow_path", "INVALID_TARGET"): Trial(lines([[0.1, 0.0], [0.1, 0.0]])),
    ("follow_path", "TOO_FAST"): Trial(lines(SQUARE, tool_speed=0.5)),
    ("follow_path", "UNREACHABLE"): Trial(lines([[0.5, 0.5], [0.5, -0.5]])),
    ("follow_path", "SINGULAR"): Trial(lines(FLAT_EIGHT)),
    ("follow_path", "PATH_BROKEN"): Trial(lines(WIDE, plane="xz"), {"arm": PANDA}),
    ("follow_path", "IN_COLLISION"): Trial(lines(SQUARE), {"objects": BESIDE}),
    **moving("follow_path", lines(SQUARE), 1.5),
    ("move_linear", "SINGULAR"): Trial({"move_linear": {"offset": {"xyz": [0.5, 0, 0]}}}),
    ("move_linear", "PATH_BROKEN"): Trial(
        {"move_linear": {"offset": {"rpy": [0, 90, 0], "frame": "tool"}}}, {"arm": PANDA}
    ),
    ("move_linear", "IN_COLLISION"): Trial(
        {"move_linear": {"offset": {"xyz": [0, 0.12, 0]}}}, {"objects": BESIDE}
    ),
    ("move_linear", "KEEP_VIOLATED"): Trial(
        {"move_linear": {"offset": {"rpy": [30, 0, 0]}, "keep": {"upright": 5}}}
    ),
    **moving("move_linear", {"move_linear": {"offset": {"xyz": [0, 0.1, 0]}}}, 0.4),
    ("move_until_contact", "IN_COLLISION"): Trial(
        {"move_until_contact": {"direction": [0, 1, 0], "distance": 0.4, "speed": 0.2}},
        {"objects": {"post": slab([0.25, 0.30, 0.75], [0.06, 0.06, 0.3])}},
        moves=True,
    ),
    ("move_until_contact", "FORCE_LIMIT"): Trial(
        {"move_until_contact": {"direction": [1, 0, 0], "distance": 0.08, "speed": 0.1}},
        {"arm": PRESENTING | {"force_limit": 10}},
        moves=True,
    ),
    ("move_until_contact", "NO_CONTACT"): Trial(
        {"move_until_contact": {"direction": [0, 0, 1], "distance": 0.03}}, moves=True
    ),
    **losing("move_until_contact", {"direction": [0, 0, 1], "distance": 0.3, "speed": 0.1}),
    **moving(
        "move_until_contact",
        {"move_until_contact": {"direction": [0, 1, 0], "force": 200, "speed": 0.3}},
        0.4,
    ),
    ("move_through", "INVALID_TARGET"): Trial(
        {"move_through": {"poses": [{"xyz": [0.4, 0, 0.7]}, {"xyz": [0.4, 0, 0.7]}]}}
    ),
    ("move_through", "SINGULAR"): Trial({"move_through": {"poses": [FAR]}}),
    ("move_through", "PATH_BROKEN"): Trial(
        {"move_through": {"poses": [{"xyz": [0.3, 0, 0.487], "rpy": [180, -90, 0]}]}},
        {"arm": PANDA},
    ),
    ("move_through", "IN_COLLISION"): Trial(
        {"move_through": {"poses": [{"xyz": [0.45, 0.1, 0.5]}]}}, {"objects": LOW_CEILING}
    ),
    **moving("move_through", {"move_through": {"poses": [{"xyz": [0.5, 0.2, 0.7]}]}}, 0.4),
    ("rotate_tool", "INVALID_TARGET"): Trial({"rotate_tool": {"angle": 0}}),
    ("rotate_tool", "SINGULAR"): Trial(
        {"rotate_tool": {"axis": "y", "angle": -90, "point": [-0.4, 0, 0]}}
    ),
    ("rotate_tool", "PATH_BROKEN"): Trial({"rotate_tool": {"angle": 720}}),
    ("rotate_tool", "IN_COLLISION"): Trial(
        {"rotate_tool": {"axis": "y", "angle": 40, "point": [0, 0, -0.5]}}, {"objects": BESIDE}
    ),
    **moving("rotate_tool", {"rotate_tool": {"angle": 90}}, 0.4),
    # Carrying along paths
    **losing("circle", {"plane": "xy", "radius": 0.05, "speed": 0.1}),
    **losing("lissajous", {"plane": "xy", "amplitudes": [0.05, 0.05], "speed": 0.1}),
    **losing("draw", {"plane": "xy", "points": SMALL, "speed": 0.1}),
    **losing("follow_path", {"plane": "xy", "points": SMALL, "scale": 1.0, "tool_speed": 0.03}),
    **losing("move_linear", {"offset": {"xyz": [0, 0, 0.2]}, "speed": 0.1}),
    **losing(
        "move_through", {"poses": [{"xyz": [0.40, -0.45, z]} for z in (0.55, 0.70)], "speed": 0.1}
    ),
    **losing("rotate_tool", {"angle": 60, "speed": 0.1}),
    # Handling objects with a gripper
    ("open_gripper", "INVALID_TARGET"): Trial(
        {"open_gripper": {"width": "{width}"}}, {"before": known_late("width", 0.2)}
    ),
    ("open_gripper", "NOT_OPEN"): Trial(
        {"open_gripper": {"width": 0.02}}, interventions=((0.0, jams),)
    ),
    ("close_gripper", "EMPTY"): Trial(TAKE, {"objects": {}}),
    ("close_gripper", "INVALID_TARGET"): Trial(
        {"close_gripper": {"force": "{force}"}}, {"before": known_late("force", 500)}
    ),
    ("close_gripper", "NOT_THERE"): Trial(
        {"close_gripper": {"force": 40, "object": "cube"}}, {"before": REMOVED}
    ),
    ("close_gripper", "NOT_CLOSED"): Trial(TAKE, {"objects": {}}, interventions=((0.0, clogs),)),
    ("close_gripper", "GRIPPER_FULL"): Trial(
        {"close_gripper": {"force": 40, "object": "other"}},
        {"before": (GRASP,), "objects": TWO_CUBES, "scene": "table"},
        moves=True,
    ),
    ("close_gripper", "WRONG_OBJECT"): Trial(
        {"close_gripper": {"force": 40, "object": "other"}},
        {"objects": CLOSED["objects"]},
    ),
    ("release", "INVALID_TARGET"): Trial(
        {"release": {"speed": "{speed}"}}, {"before": (TAKE, *known_late("speed", 1.5))}
    ),
    ("release", "NOT_OPEN"): Trial({"release": {}}, interventions=((0.5, jams),)),
    ("holding", "NOT_HOLDING"): Trial({"holding": {}}, {"before": ()}),
    ("operate", "NOT_HELD"): Trial(OPERATE, {"before": ()}),
    ("operate", "NOT_THERE"): Trial(OPERATE, {"before": ({"remove": {"object": "cabinet"}},)}),
    ("operate", "INVALID_TARGET"): Trial({"operate": _OPERATED | {"to": 0.3}}, {"before": ()}),
    ("operate", "BLOCKED"): Trial(
        OPERATE, interventions=((5.8, drags("cabinet.slide", 1e3)),), moves=True
    ),
    ("operate", "FORCE_LIMIT"): Trial(
        {"operate": _OPERATED | {"force": 20}},
        {"objects": cabinet_that(friction=10.0, damping=300.0)},
        moves=True,
    ),
    ("operate", "NOT_REACHED"): Trial(
        OPERATE,
        {"before": ({"grasp": PULLS["grasp"] | {"approach": [1, 0, 0]}},)},
        interventions=(
            (8.2, slips("cabinet.slide", -0.008)),
            (8.22, drags("cabinet.slide", 1e3)),
        ),
        moves=True,
    ),
    ("operate", "OBJECT_MOVED"): Trial(
        {"operate": {"object": "chest", "joint": "hinge", "to": 60}},
        {"objects": STIFF_CHEST, "before": (KNOB,)},
        moves=True,
    ),
    ("operate", "SLIPPED"): Trial(
        OPERATE, interventions=((6.1, narrows("cabinet.slide", "handle", 0.6)),), moves=True
    ),
    ("operate", "DROPPED"): Trial(
        OPERATE, interventions=((6.1, narrows("cabinet.slide", "handle", 0.01)),), moves=True
    ),
    ("grasp", "GRIPPER_FULL"): Trial({"grasp": {"object": "other"}}, CLOSED),
    ("grasp", "INVALID_TARGET"): Trial(GRASP, {"objects": cube_that(fixed=True)}),
    ("grasp", "NOT_THERE"): Trial(GRASP, {"before": REMOVED}),
    ("grasp", "TOO_WIDE"): Trial(
        GRASP,
        {"objects": cube_that(size=[0.12] * 3, pose={"xyz": [0.40, -0.45, 0.46]})},
    ),
    ("grasp", "TOO_HEAVY"): Trial(GRASP, {"objects": cube_that(mass=8.0)}),
    ("grasp", "NO_FACE"): Trial(
        GRASP,
        {"objects": cube_that(shape="sphere", size=[0.02]), "arm": SUCKING},
    ),
    ("grasp", "OUT_OF_REACH"): Trial(GRASP, {"objects": CUBE_AWAY}),
    ("grasp", "NOT_GRASPED"): Trial(GRASP, interventions=((1.6, steals("cube")),), moves=True),
    ("grasp", "SLIPPED"): Trial(GRASP, interventions=((2.6, shrinks("cube")),), moves=True),
    ("grasp", "DROPPED"): Trial(GRASP, interventions=((2.6, steals("cube")),), moves=True),
    ("place", "NOT_HELD"): Trial(PLACE, {"before": ()}),
    ("place", "NOT_REACHED"): Trial(
        {"place": {"object": "cube", "at": {"xyz": [0.35, -0.45, 0.4205]}, "tolerance": 0.001}},
        moves=True,
    ),
    ("place", "NO_CAMERA"): Trial(placed_seen(), moves=True),
    ("place", "INVALID_TARGET"): Trial(
        placed_seen(),
        {"arm": GRIPPING | {"camera": SEEING}, "objects": cube_that(color="gray")},
        moves=True,
    ),
    ("place", "NOT_SEEN"): Trial(
        placed_seen(), {"arm": GRIPPING | {"camera": SEEING}}, ((5.7, hides("cube")),), moves=True
    ),
    ("place", "NOT_SUPPORTED"): Trial(
        {"place": {"object": "cube", "at": {"xyz": [0.35, -0.249, 0.425]}}}, moves=True
    ),
    ("place", "NOT_PLACED"): Trial(
        PLACE, interventions=((3.6, slides_in_hand("cube", 0.012)),), moves=True
    ),
    ("place", "NO_CONTACT"): Trial(
        {"place": {"object": "cube", "at": {"xyz": [0.35, -0.45, 0.5]}}}, moves=True
    ),
    ("place", "NOT_OPEN"): Trial(PLACE, interventions=((4.2, jams),), moves=True),
    ("place", "SLIPPED"): Trial(PLACE, interventions=((3.6, shrinks("cube")),), moves=True),
    ("place", "DROPPED"): Trial(PLACE, interventions=((3.6, steals("cube")),), moves=True),
    ("place", "SPILLED"): Trial(PLACE, LOADED, ((3.6, steals("rider")),), moves=True),
    ("regrasp", "NOT_HELD"): Trial({"regrasp": {}}, {"before": ()}),
    ("regrasp", "GRIPPER_FULL"): Trial({"regrasp": {"object": "other"}}, CLOSED),
    ("regrasp", "INVALID_TARGET"): Trial(AGAIN, {"before": (), "objects": cube_that(fixed=True)}),
    ("regrasp", "NOT_THERE"): Trial(AGAIN, {"before": REMOVED}),
    ("regrasp", "TOO_WIDE"): Trial(
        AGAIN,
        {"before": (), "objects": cube_that(size=[0.12] * 3, pose={"xyz": [0.40, -0.45, 0.46]})},
    ),
    ("regrasp", "TOO_HEAVY"): Trial(AGAIN, {"before": (), "objects": cube_that(mass=8.0)}),
    ("regrasp", "NO_FACE"): Trial(
        AGAIN,
        {"before": (), "objects": cube_that(shape="sphere", size=[0.02]), "arm": SUCKING},
    ),
    ("regrasp", "OUT_OF_REACH"): Trial({"regrasp": {"approach": [0, 0, 1]}}, moves=True),
    ("regrasp", "NOT_REACHED"): Trial(
        {"regrasp": {"at": {"xyz": [0.35, -0.45, 0.4205]}}}, moves=True
    ),
    ("regrasp", "NOT_SUPPORTED"): Trial(
        {"regrasp": {"at": {"xyz": [0.35, -0.249, 0.425]}}}, moves=True
    ),
    ("regrasp", "NOT_PLACED"): Trial(
        AGAIN, interventions=((3.6, slides_in_hand("cube", 0.012)),), moves=True
    ),
    ("regrasp", "NO_CONTACT"): Trial({"regrasp": {"at": {"xyz": [0.35, -0.45, 0.5]}}}, moves=True),
    ("regrasp", "NOT_OPEN"): Trial(AGAIN, interventions=((4.2, jams),), moves=True),
    ("regrasp", "NOT_GRASPED"): Trial(AGAIN, interventions=((7.0, steals("cube")),), moves=True),
    ("regrasp", "SLIPPED"): Trial(AGAIN, interventions=((3.6, shrinks("cube")),), moves=True),
    ("regrasp", "DROPPED"): Trial(AGAIN, interventions=((3.6, steals("cube")),), moves=True),
    ("insert", "NOT_HELD"): Trial(INSERT, {"before": ()}),
    ("insert", "NO_CONTACT"): Trial(inserted([0.25, -0.45, 0.5]), moves=True),
    ("insert", "NOT_FOUND"): Trial(inserted([0.262, -0.45, 0.425], radius=0.0002), moves=True),
    ("insert", "JAMMED"): Trial(inserted([0.25, -0.45, 0.415], depth=0.022), moves=True),
    ("insert", "NOT_INSERTED"): Trial(
        INSERT, {"objects": ON_TABLE}, ((4.9, slides_in_hand("cube", 0.008)),), moves=True
    ),
    ("insert", "SLIPPED"): Trial(INSERT, interventions=((6.0, shrinks("cube")),), moves=True),
    ("insert", "DROPPED"): Trial(INSERT, interventions=((6.0, steals("cube")),), moves=True),
    # Handing over
    ("hand_over", "NOT_HELD"): Trial(GIVE, {"before": ()}),
    ("hand_over", "NOT_THERE"): Trial(GIVE, {"before": REMOVED}),
    ("hand_over", "INVALID_TARGET"): Trial(
        {"hand_over": {"object": "cube", "to": "{who}"}}, {"before": (*HELD, *SELF)}, moves=True
    ),
    ("hand_over", "PARTNER_GONE"): Trial(
        GIVE, {"others": partner(TAKER, {"sequence": ["fail", TAKES]})}, moves=True
    ),
    ("hand_over", "NOT_TAKEN"): Trial(
        GIVE, interventions=((7.83, presses("cube", 25.0)),), moves=True
    ),
    ("hand_over", "NOT_OPEN"): Trial(GIVE, interventions=((8.1, jams),), moves=True),
    ("hand_over", "SPILLED"): Trial(GIVE, LOADED_BAR, ((4.5, steals("rider")),), moves=True),
    ("take_over", "SPILLED"): Trial(TAKES_FROM, LOADED_BAR, ((10.5, steals("rider")),), moves=True),
    ("take_over", "GRIPPER_FULL"): Trial(
        TAKES_FROM,
        {"before": (TAKE,), "objects": ON_SHELF | {"other": IN_TAKER}},
    ),
    ("take_over", "NOT_THERE"): Trial(TAKES_FROM, {"before": REMOVED}),
    ("take_over", "INVALID_TARGET"): Trial(
        {"take_over": {"object": "cube", "from": "{who}"}}, {"before": SELF}
    ),
    ("take_over", "PARTNER_GONE"): Trial(
        TAKES_FROM,
        {"others": partner(GIVER, {"sequence": ["fail", {"hand_over": GIVE_BACK}]})},
    ),
    ("take_over", "OUT_OF_REACH"): Trial(
        TAKES_FROM, {"arm": TAKER | {"base": {"xyz": [2.3, 0, 0], "rpy": [0, 0, 180]}}}, moves=True
    ),
    ("take_over", "SLIPPED"): Trial(
        TAKES_FROM, interventions=((9.0, shrinks("cube")),), moves=True
    ),
    ("take_over", "DROPPED"): Trial(
        TAKES_FROM, interventions=((10.5, steals("cube")),), moves=True
    ),
    # Handling objects
    ("approach_and_attach", "INVALID_TARGET"): Trial(
        {"approach_and_attach": {"object": "cube", "direction": [0, 0, 0]}}
    ),
    ("approach_and_attach", "GRIPPER_FULL"): Trial(
        {"approach_and_attach": {"object": "other"}}, CLOSED | {"arm": GRIPPING}
    ),
    ("approach_and_attach", "NOT_THERE"): Trial(PICK, {"before": REMOVED}),
    ("approach_and_attach", "OUT_OF_REACH"): Trial(PICK, {"objects": CUBE_AWAY}),
    ("approach_and_attach", "PROXIMITY_NOT_REACHED"): Trial(
        PICK, interventions=((1.0, steals("cube")),), moves=True
    ),
    **moving("approach_and_attach", PICK, 0.8),
    ("transport", "SLIPPED"): Trial(
        CARRY_FAR, GRASPED, interventions=((4.6, shrinks("cube")),), moves=True
    ),
    ("transport", "DROPPED"): Trial(
        CARRY_FAR, GRASPED, interventions=((4.6, steals("cube")),), moves=True
    ),
    ("transport", "NOT_ATTACHED"): Trial(CARRY, {"before": ()}),
    ("transport", "UNREACHABLE"): Trial({"transport": {"object": "cube", "to": FAR}}, moves=True),
    ("transport", "IN_COLLISION"): Trial(
        {"transport": {"object": "cube", "to": {"xyz": [0.4, -0.45, 0.40]}}}, moves=True
    ),
    ("transport", "NO_PLAN"): Trial(
        {"transport": {"object": "cube", "to": {"xyz": [-0.4, -0.35, 0.6]}}},
        {"objects": ON_TABLE | CROSSING, "before": (PICK, *SPLIT)},
        moves=True,
    ),
    ("transport", "KEEP_VIOLATED"): Trial(
        {"transport": CARRY["transport"] | {"keep": {"height": [0.4, 0.5]}}}, moves=True
    ),
    ("transport", "SPILLED"): Trial(
        CARRY_FAR, GRASPED | LOADED, ((4.6, steals("rider")),), moves=True
    ),
    ("transport", "NOT_REACHED"): Trial(
        {"transport": CARRY["transport"] | {"tolerance": 1e-4}},
        interventions=((4.0, pushes(HAND, 117.0)),),  # just beyond what is compensated
        moves=True,
    ),
    **moving("transport", CARRY, 4.6),
    ("detach", "NOT_THERE"): Trial(LET_GO, {"before": REMOVED}),
    ("detach", "STILL_HELD"): Trial(LET_GO, GRASPED, moves=True),
    ("detach", "NOT_AT_REST"): Trial(LET_GO, {"before": (PICK, CARRY)}, moves=True),
    # Following
    ("calibrate", "NO_CAMERA"): Trial({"calibrate": {}}, {"arm": BLIND}),
    ("calibrate", "NOT_SEEN"): Trial({"calibrate": {"color": "red"}}),
    ("calibrate", "NOT_STILL"): Trial(
        {"calibrate": {"speed": 1.0}}, interventions=((4.0, shifts("mark", 0.02)),), moves=True
    ),
    **moving("calibrate", {"calibrate": {}}, 0.6, "arm1/panda_hand"),
    ("track", "NO_CAMERA"): Trial(TRACK, {"arm": BLIND}),
    ("track", "NOT_SEEN"): Trial({"track": TRACK["track"] | {"color": "red"}}),
    ("track", "NOT_MOVED"): Trial(
        {"track": {"until_still": 1.0, "move_timeout": 0.5, "wait": 1.0}}, moves=True
    ),
    ("track", "NOT_STILL"): Trial(
        {"track": {"until_still": 1.0, "rest_timeout": 0.5, "wait": 1.0}}, moves=True
    ),
    ("track", "LOST"): Trial(TRACK, interventions=((1.0, hides("cube")),), moves=True),
    ("track", "NOT_FOLLOWING"): Trial(
        {"track": TRACK["track"] | {"max_error": 0.001}},
        interventions=((1.0, shifts("cube", 0.05)),),
        moves=True,
    ),
    ("track", "IN_COLLISION"): Trial(
        FOLLOW_HOLDING,
        {
            "objects": FOLLOWED | BLOCK,
            "arm": GRIPPING | {"camera": LOW_CAMERA},
            "scene": "table",
            "before": LOOK_HOLDING,
        },
        interventions=((5.6, shifts("other", 0.08)),),
        moves=True,
    ),
    ("track", "UNREACHABLE"): Trial(  # at 0.1 m/s: an object that jumps is not the target
        TRACK,
        interventions=tuple((1.0 + 0.02 * step, shifts("cube", 0.002)) for step in range(70)),
        moves=True,
    ),
    **moving("track", TRACK, 1.0, "arm1/panda_hand"),
    # Seeing
    ("locate", "NO_CAMERA"): Trial(LOCATE, {"arm": BLIND}),
    ("locate", "INVALID_TARGET"): Trial(LOCATE, {"objects": {"cube": GREY}}),
    ("locate", "NOT_SEEN"): Trial({"locate": {"object": "cube", "color": "red"}}),
    ("locate", "WRONG_SIZE"): Trial(
        {"locate": {"object": "larger"}}, {"objects": TARGET | LARGER}, moves=True
    ),
    ("locate", "INACCURATE"): Trial({"locate": {"object": "cube", "views": 1}}),
    **moving("locate", LOCATE, 0.9, "arm1/panda_hand"),
    ("wait_for", "NO_CAMERA"): Trial(WAIT_FOR, {"arm": BLIND}),
    ("wait_for", "INVALID_TARGET"): Trial(WAIT_FOR, {"objects": {"cube": GREY}}),
    ("wait_for", "NOT_SEEN"): Trial({"wait_for": {"object": "cube", "color": "red", "wait": 0.5}}),
    ("count", "NO_CAMERA"): Trial(COUNT, {"arm": BLIND}),
    ("count", "INVALID_TARGET"): Trial(COUNT, {"objects": {"cube": GREY}}),
    ("count", "NOT_SEEN"): Trial(
        {"count": {"object": "cube", "frames": 1}},
        {"arm": BLINDED, "before": (after(2.7, {"wait_for": {"object": "cube", "confirm": 99}}),)},
    ),
    ("count", "AMBIGUOUS"): Trial(COUNT, {"objects": TARGET | TOUCHING}),
    ("look_at", "NO_CAMERA"): Trial(LOOK, {"arm": BLIND}),
    ("look_at", "OUT_OF_REACH"): Trial({"look_at": {"at": {"xyz": [-2.0, 0.11, 0.7]}}}),
    **moving("look_at", LOOK, 0.4, "arm1/panda_hand"),
    ("scan", "NO_CAMERA"): Trial(SCAN, {"arm": {"robot": "ur5", "base": ABOVE}}),
    ("scan", "INVALID_TARGET"): Trial(SCAN, {"objects": {"cube": GREY}}),
    ("scan", "NOT_SEEN"): Trial({"scan": SCAN["scan"] | {"color": "red"}}, moves=True),
    ("scan", "OUT_OF_REACH"): Trial(
        {"scan": {"object": "cube", "color": "red", "center": [3.0, 0, 0]}}
    ),
    **moving("scan", {"scan": SCAN["scan"] | {"color": "red"}}, 0.4),
}
