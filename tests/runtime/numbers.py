"""Numbers that a tree file can contain: trees with each of them, and their declared bounds."""

from __future__ import annotations

import copy
import json
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Annotated, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeContent
from bt_dualarm.spec.explain import type_at
from bt_dualarm.spec.faults import fault_class
from bt_dualarm.spec.node_types import NodeSpec, PortModel, models_in, validate_literals
from bt_dualarm.spec.yaml_reader import LARGEST_INTEGER, Data, with_tuples
from bt_dualarm.testing import Scenario, Tree, node_of
from tests.skills.candidates import candidate
from tests.skills.scenarios import CABINET, SCENARIOS

Path: TypeAlias = tuple[str | int, ...]

CELL: Tree = {
    "signals": {"go": {"type": "number", "written_by": ["arm1"], "initial": 1.0}},
    "zones": {"bin": {"size": [0.1, 0.1, 0.1], "pose": {"xyz": [0.5, 0, 0.2], "rpy": [0, 0, 5]}}},
    "rendezvous": {"there": ["arm1", "arm2"]},
}
"""The cell that a second arm shares, for node types that need one."""

SHARING = ("await", "meet", "claim", "in_step", "arm_near")
"""Node types whose files have that cell."""

PARTNERS: Mapping[str, Tree] = {
    "meet": {"meet": "there"},
    "in_step": {"in_step": {"with": "arm1", "child": "succeed"}},
}
"""Trees of the second arm, where it takes part in the node."""

_TIMED: Tree = {"begin": 0.1, "until": 5.0, "probability": 0.5}
_ELBOW: Tree = {"arm": "arm1", "joint": "panda_joint4"}

FILE: Tree = {
    "bt_dualarm": 1,
    "world": {"scene": "empty", "seed": 1, "timestep": 0.002, "time_limit": 30.0},
    "objects": {
        "box": {
            "shape": "box",
            "size": [0.05, 0.05, 0.05],
            "mass": 0.1,
            "friction": 0.8,
            "color": [0.9, 0.9, 0.1, 1.0],
            "pose": {"xyz": [0.7, 0.5, 0.3], "rpy": [0, 0, 10]},
            "noise": {"xyz": [0.01, 0.01, 0.01], "yaw": 5.0},
            "marker": {"id": 3, "size": 0.03},
        },
        "ball": {
            "shape": "sphere",
            "size": [0.03],
            "mass": 0.1,
            "texture": {"pattern": "dots", "color": [0.1, 0.1, 0.9], "size": 0.01},
            "pose": {"xyz": [-0.7, 0.5, 0.3], "quat": [1.0, 0, 0, 0]},
        },
        "prism": {
            "shape": "prism",
            "size": [0.03, 0.1],
            "sides": 5,
            "mass": 0.1,
            "pose": {"xyz": [-0.9, -0.5, 0.3]},
        },
        "cup": {
            "shape": "cup",
            "size": [0.03, 0.1],
            "wall": 0.004,
            "mass": 0.1,
            "pose": {"xyz": [-0.9, 0.5, 0.3]},
        },
        "rack": {
            "shape": "shelf",
            "size": [0.2, 0.2, 0.4],
            "wall": 0.01,
            "boards": 4,
            "mass": 1.0,
            "pose": {"xyz": [-1.5, 0, 0.3]},
        },
        "door": {
            "shape": "compound",
            "mass": 1.0,
            "fixed": True,
            "pose": {"xyz": [-3.5, 0, 0.5]},
            "parts": {
                "post": {"shape": "box", "size": [0.02, 0.02, 0.4]},
                "panel": {
                    "shape": "box",
                    "size": [0.2, 0.02, 0.4],
                    "pose": {"xyz": [0.12, 0, 0]},
                },
            },
            "joints": {
                "hinge": {
                    "type": "hinge",
                    "parts": ["panel"],
                    "axis": [0, 0, 1.0],
                    "anchor": [0.01, 0.01, 0],
                    "range": [-90, 0],
                    "at": -20,
                    "mass": 1.0,
                    "damping": 1.0,
                    "friction": 0.5,
                    "spring": 0.1,
                    "rest": -30,
                }
            },
        },
        "post": {
            "shape": "box",
            "size": [0.02, 0.02, 0.1],
            "mass": 1.0,
            "pose": {"xyz": [-2.5, 0, 0.3]},
            "many": {"grid": [2, 1], "spacing": [0.2, 0.1], "gap": 0.05},
        },
        "tower": {
            "shape": "box",
            "size": [0.05, 0.05, 0.05],
            "mass": 1.0,
            "pose": {"xyz": [-2.5, 2, 0.3]},
            "many": {
                "stack": 2,
                "sizes": [[0.04, 0.04, 0.04], [0.05, 0.05, 0.05]],
                "colors": [[0.9, 0.9, 0.1]],
            },
        },
        "loose": {
            "shape": "sphere",
            "size": [0.02],
            "mass": 1.0,
            "pose": {"xyz": [-2.5, -2, 0.3]},
            "many": {"scatter": 2, "area": [0.4, 0.4], "yaw": 90.0},
        },
        "heap": {
            "shape": "sphere",
            "size": [0.02],
            "mass": 1.0,
            "pose": {"xyz": [-2.5, -3, 0.3]},
            "many": {"pile": 2},
        },
        "bracket": {
            "shape": "mesh",
            "file": "tests/runtime/bracket.obj",
            "scale": 0.001,
            "mass": 1.0,
            "pose": {"xyz": [-2.5, -4, 0.3]},
            "spawned": False,
        },
        "mug": {
            "shape": "compound",
            "mass": 0.1,
            "pose": {"xyz": [-0.9, 0, 0.3]},
            "parts": {
                "body": {
                    "shape": "cup",
                    "size": [0.04, 0.1],
                    "wall": 0.004,
                    "density": 1.0,
                    "color": [0.9, 0.9, 0.1, 1.0],
                },
                "base": {
                    "shape": "shelf",
                    "size": [0.05, 0.05, 0.05],
                    "boards": 2,
                    "wall": 0.004,
                    "pose": {"xyz": [0, 0, -0.1]},
                },
                "handle": {
                    "shape": "prism",
                    "size": [0.01, 0.05],
                    "sides": 8,
                    "pose": {"xyz": [0.05, 0, 0], "rpy": [0, 0, 10]},
                },
            },
        },
        "can": {
            "shape": "cylinder",
            "size": [0.03, 0.1],
            "mass": 0.1,
            "pose": {"xyz": [-0.7, -0.5, 0.3], "look_at": [0, 0, 1.0]},
        },
    },
    "cell": {"zones": CELL["zones"]},
    "arms": {
        "arm1": {
            "robot": "panda",
            "base": {"xyz": [0, 0, 0.2], "rpy": [0, 0, 0]},
            "locked": {"panda_finger_joint1": 0.02},
            "limits": {"velocity": 0.5, "acceleration": 0.5, "jerk": 0.5},
            "reality": {
                "links": {"mass": {"uniform": 0.05}, "center": {"normal": 0.001}},
                "friction": {"present": True, "most": 0.05},
                "encoder": {"resolution": 0.001, "noise": 0.001, "window": 0.004, "cutoff": 50.0},
                "drive": {"delay": 0.001, "bandwidth": 300.0, "quantum": 0.001},
                "camera": {
                    "noise": 1.0,
                    "exposure": 0.005,
                    "k1": {"uniform": 0.01},
                    "k2": {"normal": 0.01},
                },
            },
            "force_limit": 100.0,
            "collision": {"stop": True, "threshold": 1.5},
            "tick_hz": 50.0,
            "camera": {
                "mount": {"xyz": [1.0, 0, 1.0], "look_at": [0, 0, 0.5]},
                "resolution": [64, 48],
                "fov": 50.0,
                "fps": 30.0,
                "latency": 0.01,
                "drop": 0.1,
                "noise": 1.0,
            },
            "tree": {"sequence": [{"move_joints": {"by": {"panda_joint1": 10}}}, {"wait": 3.0}]},
        }
    },
    "goal": {
        "there": {
            "object": "box",
            "at": {"xyz": [0.7, 0.5, 0.3]},
            "within": 0.01,
            "angle": 5.0,
            "tilt": 5.0,
            "height": [0.1, 0.4],
            "speed": 0.1,
            "distance_to": "ball",
            "apart": 0.1,
            "lasting": 0.1,
        },
        "gentle": {"tool": "arm1", "force": 10.0},
        "shut": {"object": "door", "joint": "hinge", "between": [-90, 0.0]},
    },
    "faults": {
        "stuck": {
            "arm": "arm1",
            "leaf": "wait",
            "phase": "during",
            "after": 0.1,
            "begin": 0.1,
            "until": 5.0,
            "times": 1,
            "probability": 0.5,
        },
        "frozen": {**_TIMED, **_ELBOW, "kind": "frozen_joint"},
        "weak": {**_TIMED, **_ELBOW, "kind": "weak_joint", "strength": 0.3},
        "loose": {**_TIMED, **_ELBOW, "kind": "loose_joint", "play": 2.0},
        "saturated": {**_TIMED, **_ELBOW, "kind": "saturated_drive", "limit": 0.2},
        "repeating": {**_TIMED, **_ELBOW, "kind": "stuck_encoder"},
        "old_image": {**_TIMED, "kind": "frozen_camera", "arm": "arm1"},
        "dark": {**_TIMED, "kind": "dark_camera", "arm": "arm1", "brightness": 0.1},
        "late": {**_TIMED, "kind": "late_camera", "arm": "arm1", "delay": 0.5},
        "shaking": {**_TIMED, "kind": "shaking_camera", "arm": "arm1", "angle": 1.0},
        "pushed": {
            **_TIMED,
            "kind": "pushed_object",
            "object": "box",
            "force": [1.0, -1.0, 0.5],
        },
        "swapped": {**_TIMED, "kind": "swapped_object", "object": "box", "other": "can"},
        "removed": {**_TIMED, "kind": "removed_object", "object": "ball"},
        "slippery": {**_TIMED, "kind": "reduced_friction", "object": "can", "friction": 0.05},
        "planless": {**_TIMED, "kind": "no_plan", "arm": "arm1"},
        "absent": {**_TIMED, "kind": "absent_partner", "arm": "arm1"},
    },
}
"""A file that gives every number of the world, of objects, arms and cameras."""

NODES: tuple[Tree, ...] = (
    {"parallel": {"policy": 1, "children": ["succeed", {"wait": 1.0}]}},
    {"switch": {"value": 1, "cases": {"1": "succeed"}, "default": "succeed"}},
    {"retry": {"times": 3, "delay": 0.05, "child": "fail"}},
    {"repeat": {"times": 3, "child": "succeed"}},
    {"timeout": {"seconds": 1.0, "child": {"wait": 5.0}}},
    {"delay": {"seconds": 1.0, "child": {"wait": 5.0}}},
    {"rate": {"hz": 10.0, "child": {"wait": 5.0}}},
    {"wait": {"seconds": 1.0}},
    {"compare": {"value": 1.0, "relation": "near", "to": 1.0, "tolerance": 1e-6}},
    {"await": {"signal": "go", "relation": "near", "to": 1.0, "tolerance": 1e-6, "timeout": 1.0}},
    {"meet": {"at": "there", "timeout": 1.0}},
    {"claim": {"zone": "bin", "timeout": 1.0, "child": "succeed"}},
    {"in_step": {"with": "arm2", "timeout": 1.0, "child": "succeed"}},
    {"arm_at": {"at": {"xyz": [0.35, 0.1, 0.55], "rpy": [0, 0, 5]}, "within": 0.01, "angle": 5.0}},
    {"arm_near": {"arm": "arm2", "within": 0.3}},
    {"force_above": {"force": 20.0, "direction": [0, 0, 1.0]}},
    {"touching": {"by": "joints", "fingers": 2.0, "joints": 30.0}},
    {"elapsed": {"seconds": 1.0}},
)
JOINT_CONDITIONS: tuple[Tree, ...] = (
    {"joint_at": {"object": "cabinet", "joint": "slide", "above": 0.1}},
    {"joint_at": {"object": "cabinet", "joint": "slide", "below": 0.1}},
    {"joint_at": {"object": "cabinet", "joint": "slide", "between": [-1.0, 1.0]}},
)
"""Conditions on a joint of an object."""
_POSE = {"xyz": [0.35, 0.1, 0.55]}
TARGETS: tuple[Tree, ...] = (
    {"marker": {"id": 3, "size": 0.03}},
    {
        "marker": {"id": 3, "size": 0.03},
        "region": {"size": [1.0, 1.0, 1.0], "pose": {"xyz": [0.5, 0.1, 0.5], "rpy": [0, 0, 5]}},
    },
    {
        "shape": "box",
        "size": [0.05, 0.05, 0.05],
        "color": {"ranges": [{"hue": [42.0, 70.0], "saturation": [0.4, 1.0], "value": [0.2, 1.0]}]},
    },
)
"""Targets that skills may look for."""

FORMS: Mapping[str, tuple[Tree, ...]] = {
    "circle": ({"plane": {"normal": [0.0, 0.0, 1.0]}},),
    "move_joints": (
        {"to": [0, -90, -90, -90, 90, 0]},
        {"to": {"shoulder_pan_joint": 10.0}},
        {"by": {"shoulder_pan_joint": 10.0}},
        {"by": [0, 5, 5, 0, 0, 5]},
    ),
    "move_linear": (
        {"offset": {"xyz": [0, 0, 0.05], "rpy": [0, 0, 5]}},
        {"to": {**_POSE, "rpy": [180, 0, 0]}},
    ),
    "reach_to_pose": (
        {"offset": {"xyz": [0, 0, 0.05], "rpy": [0, 0, 5]}},
        {"to": {**_POSE, "rpy": [180, 0, 0]}},
        {"to": {**_POSE, "quat": [0, 1.0, 0, 0]}},
        {"to": {**_POSE, "look_at": [0.35, 0.1, 0]}},
        {"to": {"in_frame": "base", "xyz": [0.4, 0.1, 0.3], "rpy": [180, 0, 0]}},
        {"to": {"in_frame": "base", "xyz": [0.4, 0.1, 0.3], "quat": [0, 1.0, 0, 0]}},
        {
            "offset": {"xyz": [0, 0, 0.05]},
            "keep": {"upright": 5, "height": [0.1, 2.0], "facing": {"toward": {**_POSE}}},
        },
        {
            "offset": {"xyz": [0, 0, 0.05]},
            "keep": {"facing": {"direction": [0, 0, -1.0], "within": 80}},
        },
    ),
    "rotate_tool": ({"angle": 10, "axis": [0, 0, 1]},),
    "spawn": ({"object": "cube", "at": {"xyz": [0.6, 0, 0.3]}},),
    "approach_and_attach": (
        {"object": "cube", "direction": [0, 0, -1]},
        {"object": "cube", "at": {"xyz": [0.40, -0.45, 0.425]}},
        {"object": "cube", "at": {"above": "cube", "by": 0.01}},
    ),
    "grasp": (
        {"object": "cube", "point": [0, 0, 0.01], "open_to": 0.07},
        {"object": "cube", "then_to": 0.1},
        {
            "object": "cube",
            "at": {"xyz": [0.40, -0.45, 0.425]},
            "most_force": 60.0,
            "force": 40.0,
            "mass": 0.3,
        },
        {
            "at": {"xyz": [0.40, -0.45, 0.425]},
            "width": 0.05,
            "height": 0.05,
            "depth": 0.05,
            "friction": 0.8,
            "approach": [0, 0, -1],
        },
    ),
    "regrasp": (
        {
            "object": "cube",
            "most_force": 60.0,
            "force": 40.0,
            "mass": 0.3,
            "approach": [0, 0, -1],
        },
    ),
    "carry_together": tuple(
        {"object": "beam", "with": ["arm2"], **form}
        for form in (
            {"to": {"xyz": [0, -0.5, 0.525], "rpy": [0, 0, 5.0]}, "mass": 4.0},
            {"path": [{"xyz": [0, -0.5, 0.525], "quat": [1.0, 0, 0, 0]}]},
            {"to": {"xyz": [0, -0.5, 0.525], "look_at": [0, -0.5, 1.0]}},
        )
    ),
    "hand_over": tuple(
        {"object": "cube", "to": "arm2"} | form
        for form in (
            {"at": {"xyz": [0.5, 0, 0.5]}, "orientation": [0, 0, 10.0]},
            {"at": {"xyz": [0.5, 0, 0.5], "rpy": [0, 0, 10.0]}},
            {"at": {"xyz": [0.5, 0, 0.5], "quat": [1.0, 0, 0, 0]}},
            {"at": {"xyz": [0.5, 0, 0.5], "look_at": [0.5, 0.1, 0]}},
        )
    ),
    "take_over": (
        {"object": "cube", "from": "arm2", "most_force": 60.0, "force": 40.0, "mass": 0.3},
    ),
    "open_gripper": ({"width": 0.06, "speed": 0.05, "force": 40.0},),
    "close_gripper": ({"width": 0.06, "speed": 0.05, "force": 40.0},),
    "release": ({"width": 0.02, "speed": 0.05},),
    "follow_tool": (
        {
            "arm": "arm2",
            "offset": {**_POSE, "rpy": [0, 180, 0]},
            "duration": 1.0,
            "until_still": 1.0,
        },
        {"arm": "arm2", "offset": {**_POSE, "quat": [0, 1.0, 0, 0]}},
        {"arm": "arm2", "offset": {**_POSE, "look_at": [0.35, 0.1, 0]}},
    ),
    "look_at": ({"at": {"xyz": [0.68, 0.11, 0.70]}, "direction": [-1, 0, 0]},),
    **dict.fromkeys(("scan", "locate", "wait_for"), TARGETS),
    "count": tuple(form | {"height": 0.4} for form in TARGETS),
    "track": (
        {
            "color": {
                "ranges": [{"hue": [42.0, 70.0], "saturation": [0.4, 1.0], "value": [0.2, 1.0]}]
            },
            "target_size": 0.05,
            "max_error": 0.01,
            "plane": {"normal": [1.0, 0.0, 0.0]},
            "duration": 2.0,
            "until_still": 1.0,
        },
    ),
}
"""Ports of skills, in addition to their examples and defaults, such that all forms together give
every port that can hold a number."""


@dataclass(frozen=True)
class Number:
    """One number in a tree file.

    Attributes:
        file: The whole file.
        path: Path of the number in it.
        node: Path of the node of which it is a port; empty where it is a field of the file.
        model: Model of the node's ports, or of the file.
        skill: Skill whose scenario contains the node; empty if no node runs before it.
    """

    file: Tree
    path: Path
    node: Path
    model: type[BaseModel]
    skill: str = ""

    def __str__(self) -> str:
        return ".".join(str(part) for part in self.path[len(self.node) :])

    @property
    def steps(self) -> float:
        """Simulated seconds until the node has had its first ticks."""
        return 0.2 + (begin(self.skill) if self.skill else 0.0)

    @property
    def field(self) -> str:
        """Name of the innermost field that holds it."""
        return next(part for part in reversed(self.path) if isinstance(part, str))

    @property
    def owner(self) -> tuple[type[BaseModel], str]:
        """The innermost model with the name of its field."""
        path = self.path[len(self.node) :]
        if path[0] == "faults":  # a union, whose member is given by ``kind``
            return fault_class(at(self.file, self.path[:2])), str(path[2])
        for bound in reversed(range(len(path))):
            given = at(self.file, (*self.node, *path[:bound]))
            models = list(models_in(type_at(self.model, path[:bound])))
            # Of a union, the member that has all of the fields.
            models.sort(
                key=lambda model: (
                    not given.keys() <= model.model_fields.keys()
                    if isinstance(given, dict)
                    else True
                )
            )
            for model in models:
                if path[bound] in model.model_fields:
                    return model, str(path[bound])
        raise LookupError(str(self))

    @property
    def value(self) -> int | float:
        """The value that it has in the file."""
        value: int | float = at(self.file, self.path)
        return value

    def set_to(self, value: Data) -> Tree:
        """The file with another value in its place."""
        changed: Tree = with_value(self.file, self.path, value)
        return changed

    def is_accepted(self, value: float) -> bool:
        """Whether the model accepts a value."""
        data = self.set_to(value)
        try:
            if issubclass(self.model, PortModel):
                given = at(data, self.node)
                fields = self.model.model_fields.keys()
                validate_literals(self.model, {name: given[name] for name in fields & given.keys()})
            else:
                data = with_value(data, ("arms", "arm1", "tree"), NodeSpec("wait", "wait", {}))
                data = {key: item for key, item in data.items() if key != "bt_dualarm"}
                self.model.model_validate(with_tuples({"name": "all", **data}))
        except ValidationError:
            return False
        return True

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest number that the model accepts, exactly."""
        return self.bound(-1), self.bound(1)

    @cached_property
    def is_integer(self) -> bool:
        """Whether only integers are accepted."""
        return not self.is_accepted(self.value + 1e-6) and not self.is_accepted(self.value - 1e-6)

    def bound(self, sign: int) -> float:
        """The last number that is accepted toward the largest, or the smallest, possible one.

        Args:
            sign: 1 for the largest, -1 for the smallest.
        """
        if self.is_integer:
            return float(_last(self.is_accepted, int(self.value), sign * LARGEST_INTEGER))
        accepted = order(self.value)
        refused = order(sign * sys.float_info.max)
        return number(
            _last(lambda place: self.is_accepted(number(place)), accepted, refused, rounded)
        )


def _last(
    is_accepted: Callable[[int], bool],
    accepted: int,
    refused: int,
    guess: Callable[[int], int] | None = None,
) -> int:
    """The last integer that is accepted toward one that may be refused.

    Args:
        is_taken: Whether a number is accepted.
        taken: An accepted number.
        refused: The last number that may be accepted.
        guess: Returns the likely bound, given a number near it; zero is likely, too.
    """
    if is_accepted(refused):
        return refused
    step = 1 if refused > accepted else -1
    candidates = [] if guess is None else [-step, 0, step]
    while abs(refused - accepted) > 1:
        middle = (accepted + refused) // 2
        if guess is not None and abs(refused - accepted) < NEAR:
            bound = guess(middle)
            candidates = [bound - step, bound, bound + step]
            guess = None
        for place in (*candidates, middle):
            if (place - accepted) * step > 0 and (refused - place) * step > 0:
                accepted, refused = (place, refused) if is_accepted(place) else (accepted, place)
        candidates = []
    return accepted


NEAR = 2**38
"""Places between two numbers whose first four digits are the same, give or take one."""


def rounded(place: int) -> int:
    """The place of the number with three digits that is nearest to the one at a place."""
    return order(float(f"{number(place):.2e}"))


def with_value(data: Data, path: Path, value: Data) -> Data:
    """A copy of data with another value at a path; data beside the path are shared."""
    if not path:
        return value
    changed = copy.copy(data)
    changed[path[0]] = with_value(data[path[0]], path[1:], value)
    return changed


def at(data: Data, path: Path) -> Data:
    for part in path:
        data = data[part]
    return data


def order(value: float) -> int:
    """The place of a number among all that a double can be."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return int(bits) if bits >= 0 else -(bits & 0x7FFFFFFFFFFFFFFF)


def number(place: int) -> float:
    """The number at a place; the inverse of `order`."""
    value = struct.unpack("<d", struct.pack("<q", abs(place)))[0]
    return float(value if place >= 0 else -value)


def numbers(registry: Registry) -> Iterator[Number]:
    """Every number of the file, of the node types and of the shipped skills."""
    for path in _paths(FILE):
        if path != ("bt_dualarm",) and "tree" not in path:
            yield Number(FILE, path, (), TreeContent)
    for node in NODES:
        (node_type,) = node
        yield from _of_node(Scenario(), node, LANGUAGE[node_type].ports, "")
    for node in JOINT_CONDITIONS:
        yield from _of_node(Scenario(CABINET), node, LANGUAGE["joint_at"].ports, "")
    seeing = SCENARIOS["count"]
    seen: tuple[Tree, ...] = (
        *({"sees": {**form, "least": 1}} for form in TARGETS),
        {"object_at": {"object": "cube", "at": [0.4, 0.1, 0.4], "within": 0.02}},
    )
    for node in seen:
        (node_type,) = node
        yield from _of_node(seeing, node, LANGUAGE[node_type].ports, "")
    for name, skill in registry.skills.items():
        example = node_of(skill.example)[name]
        fields = skill.Ports.model_fields.items()
        defaults = {
            name: _plain(field.default) for name, field in fields if not field.is_required()
        }
        given = {name: value for name, value in defaults.items() if value is not None}
        for form in ({}, *FORMS.get(name, ())):
            ports = {**given, **(form or example)}
            skill_before = name if SCENARIOS[name].before else ""
            yield from _of_node(SCENARIOS[name], {name: ports}, skill.Ports, skill_before)


@cache
def begin(skill: str) -> float:
    """Simulated seconds that the nodes before a skill take in its scenario."""
    one = candidate(skill)
    # The skill is in the tree, because a partner's tree may need it, but is never ticked.
    untouched: Tree = {"selector": [{"succeed": {}}, one.node]}
    ended = one.perform(untouched).result.runs[-1].ended_s
    assert ended is not None
    return ended


def _of_node(
    scenario: Scenario, node: Tree, model: type[PortModel], skill: str
) -> Iterator[Number]:
    file = {"bt_dualarm": 1, **scenario.file(node)}
    (name,) = node
    if name in SHARING:
        partner = PARTNERS.get(name, "succeed")
        file["cell"] = copy.deepcopy(CELL)
        file["arms"]["arm2"] = {"robot": "ur3", "base": {"xyz": [1.5, 0, 0]}, "tree": partner}
    place = ("arms", "arm1", "tree", "sequence", len(scenario.before), name)
    ports = {port: value for port, value in node[name].items() if port in model.model_fields}
    for path in _paths(ports):
        yield Number(file, (*place, *path), place, model, skill)


def _paths(data: Data, path: Path = ()) -> Iterator[Path]:
    if isinstance(data, (dict, list)):
        for part, item in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _paths(item, (*path, part))
    elif isinstance(data, (int, float)) and not isinstance(data, bool):
        yield path


def _plain(value: object) -> Data:
    return json.loads(json.dumps(value, default=lambda model: model.model_dump(exclude_unset=True)))


def fields_of(model: type[BaseModel]) -> Iterator[tuple[type[BaseModel], str]]:
    """Every field that can hold a number, of a model and of those within it."""
    if model.__name__.startswith("_"):
        return  # it only marks what is refused
    for name, field in model.model_fields.items():
        for inner in _numbers_in(field.annotation):
            if inner is None:
                yield model, name
            else:
                yield from fields_of(inner)


def _numbers_in(annotation: object) -> Iterator[type[BaseModel] | None]:
    """Yield None for a number that is allowed, and each model that is allowed."""
    if annotation in (int, float):
        yield None
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        items = get_args(annotation)
        for item in items[:1] if get_origin(annotation) is Annotated else items:
            yield from _numbers_in(item)
