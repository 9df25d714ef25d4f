"""What stands around the trees of a file, explained for the reference: world, objects, arms."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from pydantic import BaseModel

from bt_dualarm.spec.camera import CameraSpec
from bt_dualarm.spec.describe import PortDescription, ports_of, summary_of
from bt_dualarm.spec.document import (
    ArmSpec,
    LimitShares,
    NoiseSpec,
    ObjectSpec,
    WorldSpec,
)
from bt_dualarm.spec.notation import model_name
from bt_dualarm.spec.params import ParamSpec
from bt_dualarm.spec.reality import (
    CameraErrors,
    DriveErrors,
    EncoderErrors,
    FrictionErrors,
    LinkErrors,
    PayloadErrors,
    RealitySpec,
)

_NESTED: Final[tuple[type[BaseModel], ...]] = (
    NoiseSpec,
    LimitShares,
    CameraSpec,
    RealitySpec,
    LinkErrors,
    PayloadErrors,
    FrictionErrors,
    EncoderErrors,
    DriveErrors,
    CameraErrors,
)
_MODELS: Final[tuple[type[BaseModel], ...]] = (ParamSpec, WorldSpec, ObjectSpec, ArmSpec, *_NESTED)
FILE_NAMES: Final = tuple(map(model_name, _MODELS))
"""The parts of a file, as the reference calls them."""

NESTED_NAMES: Final = tuple(map(model_name, _NESTED))
"""Those of them that are types of a field of another."""

OUTLINE: Final = """\
bt_dualarm: 1                      # version of the format
name: carry                        # by default the file's name
description: one line for people
params:                            # what a user may set: bt-run FILE --param speed=0.2
  speed: {type: number, default: 0.5, range: [0.1, 1], description: of the arm}
include: []                        # files below this one's folder whose subtrees are used here
subtrees:                          # trees with parameters of their own, for the node subtree
  pause: {params: {time: {type: duration, default: 1}}, tree: {wait: "{time}"}}
world: {scene: empty}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {xyz: [0.5, 0, 0.5]}, fixed: true}
arms:
  arm1:
    robot: ur5
    tree: {sequence: [{subtree: {use: pause}}, {go_home: {speed: "{speed}"}}]}
"""
"""A file with every part of it."""


def file_sections() -> Iterator[tuple[str, str, tuple[PortDescription, ...]]]:
    """Title, summary and fields of each part."""
    for model in _MODELS:
        yield model_name(model), summary_of(model), ports_of(model)
