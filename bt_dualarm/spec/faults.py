"""Faults that a file injects, to test what its trees do about them.

One type for each kind of fault, distinguished by ``kind``: leaves, joints with their drives and
encoders, cameras, objects, the planner, and arms whose tree does not tick. Faults of hardware and
of the world change the simulation; skills and controllers notice them from their sensors only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Literal, Self, TypeAlias, get_args

from pydantic import ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator

from bt_dualarm.spec.explain import explain, in_base_units
from bt_dualarm.spec.node_types import NodeSpec, port
from bt_dualarm.spec.problems import BodyName, Name, Problem, SpecError, suggestion
from bt_dualarm.spec.values import Duration, Value
from bt_dualarm.spec.yaml_reader import Source, TreeInput, read_tree, with_tuples

FaultEffect: TypeAlias = Literal["fail", "raise", "hang"]
"""What happens to a leaf: it fails, its code raises an exception, or it never ends."""

FaultPhase: TypeAlias = Literal["start", "during", "end"]
"""When in a run of the leaf: before its first step, after a time, or when it would succeed."""

EFFECTS: Final[tuple[FaultEffect, ...]] = ("fail", "raise", "hang")
PHASES: Final[tuple[FaultPhase, ...]] = ("start", "during", "end")

FOREVER_S: Final = 1e9
"""Default end of a fault in s: later than the end of any run."""

_Force: TypeAlias = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class FaultSpec(Value):
    """Base of all faults: when they are active, and how likely they are.

    Attributes:
        refers: Fields with names that the file declares: what each of them names.
    """

    refers: ClassVar[Mapping[str, str]] = {"arm": "arm"}

    kind: str
    begin: Duration = port(0.0, "Simulated time from which the fault is active")
    until: Duration = port(FOREVER_S, "Simulated time until which it is active")
    probability: float = port(1.0, "Probability that it happens in a run", ge=0.0, le=1.0)

    @model_validator(mode="after")
    def _times_fit(self) -> Self:
        if self.until <= self.begin:
            raise ValueError(f"until {self.until:g} s is not later than begin {self.begin:g} s")
        return self

    @property
    def on_arm(self) -> str:
        """Arm that it concerns; empty for a fault of an object."""
        return str(getattr(self, "arm", ""))

    @property
    def sentence(self) -> str:
        """What is wrong while it is active."""
        raise NotImplementedError


class LeafFault(FaultSpec):
    """A leaf fails, its code raises an exception, or it never ends."""

    kind: Literal["leaf"] = port("leaf", "Kind of the fault; `leaf` may be left out")
    arm: Name = port(..., "Arm whose tree has the leaf")
    leaf: str = port(..., "Path of the leaf in the tree, or the name of leaves", min_length=1)
    effect: FaultEffect = port(
        "fail", "The leaf fails, its code raises an exception, or it never ends"
    )
    phase: FaultPhase = port(
        "start", "Before its first step, `after` a time, or when it would succeed"
    )
    after: Duration = port(0.0, "Time since the start of the leaf, for the phase `during`")
    code: Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]*$")] = port(
        "INJECTED", "Code with which it fails"
    )
    times: int = port(1, "How many runs of the leaf have the fault", ge=1, le=1_000_000)
    probability: float = port(
        1.0, "Probability that it happens in each run of the leaf", ge=0.0, le=1.0
    )

    @model_validator(mode="after")
    def _phase_fits(self) -> Self:
        if self.after and self.phase != "during":
            raise ValueError(f"after is for the phase during, not for {self.phase}")
        return self

    @property
    def sentence(self) -> str:
        """What happens to the leaf."""
        happens = {
            "fail": f"is made to fail with {self.code}",
            "raise": "is made to raise an exception",
            "hang": "is made to hang",
        }
        return f"the leaf '{self.leaf}' {happens[self.effect]}"


class FrozenJoint(FaultSpec):
    """A joint does not move: its gears are jammed, or its brake is engaged."""

    kind: Literal["frozen_joint"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the joint")
    joint: str = port(..., "Name of the joint in the robot's description")

    @property
    def sentence(self) -> str:
        """What is wrong with the joint."""
        return f"{self.joint} of {self.arm} is frozen"


class WeakJoint(FaultSpec):
    """A drive delivers only a fraction of the torque that it is commanded to."""

    kind: Literal["weak_joint"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the joint")
    joint: str = port(..., "Name of the joint in the robot's description")
    strength: float = port(0.3, "Delivered fraction of the commanded torque", ge=0.0, lt=1.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the joint."""
        return f"{self.joint} of {self.arm} delivers {self.strength:.0%} of its torque"


class LooseJoint(FaultSpec):
    """Play between a link and its encoder, which sees only motions beyond the play."""

    kind: Literal["loose_joint"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the joint")
    joint: str = port(..., "Name of the joint in the robot's description")
    play: float = port(4.0, "Whole play", unit="deg", gt=0.0, le=90.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the joint."""
        return f"{self.joint} of {self.arm} has a play of {self.play:g}°"


class SaturatedDrive(FaultSpec):
    """A drive reaches only a fraction of its effort limit."""

    kind: Literal["saturated_drive"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the joint")
    joint: str = port(..., "Name of the joint in the robot's description")
    limit: float = port(0.2, "Fraction of its effort limit that it reaches", ge=0.0, lt=1.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the drive."""
        return f"the drive of {self.joint} of {self.arm} saturates at {self.limit:.0%} of its limit"


class StuckEncoder(FaultSpec):
    """An encoder repeats its last reading."""

    kind: Literal["stuck_encoder"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the joint")
    joint: str = port(..., "Name of the joint in the robot's description")

    @property
    def sentence(self) -> str:
        """What is wrong with the encoder."""
        return f"the encoder of {self.joint} of {self.arm} is stuck"


class FrozenCamera(FaultSpec):
    """A camera repeats the scene of its last image, with new time stamps."""

    kind: Literal["frozen_camera"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the camera")

    @property
    def sentence(self) -> str:
        """What is wrong with the camera."""
        return f"the camera of {self.arm} repeats an old image"


class DarkCamera(FaultSpec):
    """A camera receives only a share of the light."""

    kind: Literal["dark_camera"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the camera")
    brightness: float = port(0.0, "Fraction of the brightness of its images", ge=0.0, lt=1.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the camera."""
        if not self.brightness:
            return f"the camera of {self.arm} is dark"
        return f"the images of {self.arm} have {self.brightness:.0%} of their brightness"


class LateCamera(FaultSpec):
    """A camera delivers its images late, with correct time stamps."""

    kind: Literal["late_camera"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the camera")
    delay: Duration = port(0.5, "Delay in addition to the camera's latency", gt=0.0, le=60.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the camera."""
        return f"the images of {self.arm} are {self.delay:g} s late"


class ShakingCamera(FaultSpec):
    """A camera shakes: each of its images is turned at random."""

    kind: Literal["shaking_camera"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm that has the camera")
    angle: float = port(
        1.0, "Standard deviation of the rotation about x and y", unit="deg", gt=0.0, le=45.0
    )

    @property
    def sentence(self) -> str:
        """What is wrong with the camera."""
        return f"the camera of {self.arm} shakes by {self.angle:g}°"


class PushedObject(FaultSpec):
    """A force pushes an object at its center of mass."""

    refers: ClassVar[Mapping[str, str]] = {"object": "object"}

    kind: Literal["pushed_object"] = port(..., "Kind of the fault")
    object: BodyName = port(..., "Object that is pushed")
    force: tuple[_Force, _Force, _Force] = port(..., "Force along the world's axes", unit="N")

    @model_validator(mode="after")
    def _push_ends(self) -> Self:
        if self.until == FOREVER_S:
            raise ValueError("a push needs its end: give until")
        return self

    @property
    def sentence(self) -> str:
        """What happens to the object."""
        force = ", ".join(f"{part:g}" for part in self.force)
        return f"{self.object} is pushed with ({force}) N"


class SwappedObject(FaultSpec):
    """Two objects are exchanged, and exchanged again at the end of the fault."""

    refers: ClassVar[Mapping[str, str]] = {"object": "object", "other": "object"}

    kind: Literal["swapped_object"] = port(..., "Kind of the fault")
    object: BodyName = port(..., "One object")
    other: BodyName = port(..., "Object with which it swaps places")

    @model_validator(mode="after")
    def _are_two(self) -> Self:
        if self.object == self.other:
            raise ValueError(f"{self.object} cannot swap places with itself")
        return self

    @property
    def sentence(self) -> str:
        """What happens to the objects."""
        return f"{self.object} and {self.other} have swapped places"


class RemovedObject(FaultSpec):
    """An object is taken away, and put back where it was at the end of the fault."""

    refers: ClassVar[Mapping[str, str]] = {"object": "object"}

    kind: Literal["removed_object"] = port(..., "Kind of the fault")
    object: BodyName = port(..., "Object that is removed")

    @property
    def sentence(self) -> str:
        """What happens to the object."""
        return f"{self.object} is taken away"


class ReducedFriction(FaultSpec):
    """An object is slippery, whatever touches it."""

    refers: ClassVar[Mapping[str, str]] = {"object": "object"}

    kind: Literal["reduced_friction"] = port(..., "Kind of the fault")
    object: BodyName = port(..., "Object that is slippery")
    friction: float = port(0.05, "Coefficient of sliding friction", ge=0.0, le=10.0)

    @property
    def sentence(self) -> str:
        """What is wrong with the object."""
        return f"{self.object} has a friction coefficient of {self.friction:g}"


class NoPlan(FaultSpec):
    """The motion planner finds no path for an arm."""

    kind: Literal["no_plan"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm whose motions are planned")

    @property
    def sentence(self) -> str:
        """What is wrong with the planner."""
        return f"the planner finds no path for {self.arm}"


class AbsentPartner(FaultSpec):
    """An arm does not act: its tree is not ticked."""

    kind: Literal["absent_partner"] = port(..., "Kind of the fault")
    arm: Name = port(..., "Arm whose tree does not tick")

    @property
    def sentence(self) -> str:
        """What is wrong with the arm."""
        return f"the tree of {self.arm} does not tick"


KINDS: Final[Mapping[str, type[FaultSpec]]] = {
    get_args(model.model_fields["kind"].annotation)[0]: model
    for model in (
        LeafFault,
        FrozenJoint,
        WeakJoint,
        LooseJoint,
        SaturatedDrive,
        StuckEncoder,
        FrozenCamera,
        DarkCamera,
        LateCamera,
        ShakingCamera,
        PushedObject,
        SwappedObject,
        RemovedObject,
        ReducedFriction,
        NoPlan,
        AbsentPartner,
    )
}
"""All kinds of faults, by the name that a file gives them."""

CAMERA_FAULTS: Final = (FrozenCamera, DarkCamera, LateCamera, ShakingCamera)
JOINT_FAULTS: Final = (FrozenJoint, WeakJoint, LooseJoint, SaturatedDrive, StuckEncoder)
OBJECT_FAULTS: Final = (PushedObject, SwappedObject, RemovedObject, ReducedFriction)


class _UnknownFault(FaultSpec):
    """Stands for a fault of an unknown kind, so that the error names the known ones."""

    model_config = ConfigDict(extra="ignore")

    kind: Literal[tuple(KINDS)]  # type: ignore[valid-type]


_UNKNOWN: Final = "unknown kind"


def _kind_of(model: type[Value]) -> str:
    return str(get_args(model.model_fields["kind"].annotation)[0])


def fault_class(data: object) -> type[Value]:
    """Type of a fault as a file gives it; one that accepts nothing for an unknown kind."""
    kind = data.get("kind", "leaf") if isinstance(data, Mapping) else "leaf"
    return KINDS.get(kind, _UnknownFault) if isinstance(kind, str) else _UnknownFault


def _tag(data: object) -> str:
    """Tag of a fault in the union; no name of a field, so that locations are unambiguous."""
    model = type(data) if isinstance(data, FaultSpec) else fault_class(data)
    return _UNKNOWN if model is _UnknownFault else f"kind {_kind_of(model)}"


Fault: TypeAlias = Annotated[
    Annotated[LeafFault, Tag("kind leaf")]
    | Annotated[FrozenJoint, Tag("kind frozen_joint")]
    | Annotated[WeakJoint, Tag("kind weak_joint")]
    | Annotated[LooseJoint, Tag("kind loose_joint")]
    | Annotated[SaturatedDrive, Tag("kind saturated_drive")]
    | Annotated[StuckEncoder, Tag("kind stuck_encoder")]
    | Annotated[FrozenCamera, Tag("kind frozen_camera")]
    | Annotated[DarkCamera, Tag("kind dark_camera")]
    | Annotated[LateCamera, Tag("kind late_camera")]
    | Annotated[ShakingCamera, Tag("kind shaking_camera")]
    | Annotated[PushedObject, Tag("kind pushed_object")]
    | Annotated[SwappedObject, Tag("kind swapped_object")]
    | Annotated[RemovedObject, Tag("kind removed_object")]
    | Annotated[ReducedFriction, Tag("kind reduced_friction")]
    | Annotated[NoPlan, Tag("kind no_plan")]
    | Annotated[AbsentPartner, Tag("kind absent_partner")]
    | Annotated[_UnknownFault, Tag(_UNKNOWN)],
    Discriminator(_tag),
]
"""A fault of any kind."""

Faults: TypeAlias = Annotated[dict[Name, Fault], Field(max_length=200)]
"""Faults by a name of the author's choice."""


class FaultFile(Value):
    """Content of a file with nothing but faults."""

    faults: Faults = port(..., "Faults by name")


def read_faults(given: TreeInput) -> tuple[dict[str, FaultSpec], Source]:
    """Reads the faults of a file that has a section ``faults`` only.

    Args:
        given: Path of the file, YAML text, or data of the same form.

    Returns:
        The faults by name, and the source in which they are located.

    Raises:
        SpecError: The file cannot be read, or has errors.
    """
    source = read_tree(given)
    try:
        data = in_base_units(with_tuples(source.data), FaultFile.model_validate, FaultFile)
        content = FaultFile.model_validate(data)
    except ValidationError as error:
        raise SpecError(
            source.problem(found.path, found.message, found.hint, key=found.at_key)
            for found in explain(error, FaultFile, source.data, "field")
        ) from None
    return dict(content.faults), source


@dataclass(frozen=True)
class FaultEvent:
    """Start or end of a fault in a run.

    Attributes:
        time: Simulated time in s.
        name: Name of the fault in the file.
        kind: Its kind.
        arm: Arm that it concerns; empty for a fault of an object.
        sentence: What is wrong.
        is_active: Whether it starts; False for its end.
        leaf: Path of the leaf, for a fault of a leaf.
        objects: Objects that it concerns.
    """

    time: float
    name: str
    kind: str
    arm: str
    sentence: str
    is_active: bool = True
    leaf: str = ""
    objects: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Sentence for people."""
        state = "injected" if self.is_active else "ended"
        return f"fault '{self.name}' {state}: {self.sentence}"


def unique_names(children: Sequence[NodeSpec]) -> list[str]:
    """Returns the names of siblings; the second and later of equal ones are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for child in children:
        seen[child.name] += 1
        count = seen[child.name]
        names.append(child.name if count == 1 else f"{child.name}#{count}")
    return names


def leaf_paths(root: NodeSpec) -> dict[str, NodeSpec]:
    """Leaves of a tree by their path, numbered where siblings have the same name."""
    found: dict[str, NodeSpec] = {}
    waiting = [(root, root.name)]
    while waiting:
        node, path = waiting.pop()
        if not node.children:
            found[path] = node
            continue
        names = unique_names(node.children)
        waiting += [(c, f"{path}/{name}") for c, name in zip(node.children, names, strict=True)]
    return found


def fault_problems(
    faults: Mapping[str, FaultSpec],
    source: Source,
    trees: Mapping[str, NodeSpec],
    objects: Mapping[str, Any],  # only their names matter
    cameras: frozenset[str],
) -> Iterator[Problem]:
    """Yields names in faults that the file does not have.

    Args:
        faults: Faults by name.
        source: Source of the faults, below its key ``faults``.
        trees: Tree of each arm, by the arm's name.
        objects: Specifications of the objects, by name.
        cameras: Names of the arms that have a camera.
    """
    known = {"arm": trees, "object": objects}
    for name, fault in faults.items():
        unknown = False
        for field, noun in fault.refers.items():
            given = getattr(fault, field)
            at = ("faults", name, field)
            if given not in known[noun]:
                unknown = True
                hint = suggestion(given, known[noun], noun)
                yield source.problem(at, f"there is no {noun} '{given}'", hint)
            elif noun == "object" and fault.kind != "reduced_friction":
                how = "is fixed in the world" if objects[given].fixed else "moves on a joint only"
                if not objects[given].is_free:
                    message = f"'{given}' {how}: it cannot move"
                    yield source.problem(at, message, "choose an object that is not fixed")
        if unknown:
            continue
        if isinstance(fault, CAMERA_FAULTS) and fault.on_arm not in cameras:
            message = f"{fault.on_arm} has no camera"
            hint = suggestion("", cameras, "arm with a camera")
            yield source.problem(("faults", name, "arm"), message, hint)
        elif isinstance(fault, LeafFault):
            paths = leaf_paths(trees[fault.arm])
            names = {path.rpartition("/")[2] for path in paths}
            if fault.leaf not in paths.keys() | names:
                message = f"the tree of {fault.arm} has no leaf '{fault.leaf}'"
                hint = suggestion(fault.leaf, [*paths, *names], "leaf")
                yield source.problem(("faults", name, "leaf"), message, hint)


def joint_problems(
    faults: Mapping[str, FaultSpec], source: Source, joints: Mapping[str, Sequence[str]]
) -> Iterator[Problem]:
    """Yields joints in faults that the arm's robot does not have.

    Args:
        faults: Faults by name.
        source: Source of the faults, below its key ``faults``.
        joints: Names of the joints of each arm, by the arm's name; arms whose robot could not be
            read are missing.
    """
    for name, fault in faults.items():
        given = getattr(fault, "joint", None)
        known = joints.get(fault.on_arm)
        if given is not None and known is not None and given not in known:
            hint = suggestion(given, known, "joint")
            message = f"there is no joint of {fault.on_arm} '{given}'"
            yield source.problem(("faults", name, "joint"), message, hint)
