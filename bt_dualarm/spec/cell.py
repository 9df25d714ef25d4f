"""What the trees of a file share: signals, zones and rendezvous, and the checks of their use.

Each arm has its own blackboard. What arms share is declared in the section ``cell`` of the
file, so that a check of the file alone can determine which arms may write what, which meet, and
whether claims can deadlock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal, Self, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.node_types import (
    Counterpart,
    LanguageNode,
    NodeSpec,
    NodeType,
    is_dynamic,
    metadata_of,
    names_in,
    port,
)
from bt_dualarm.spec.parser import ParamSpec
from bt_dualarm.spec.problems import Name, Problem, suggestion, written_as
from bt_dualarm.spec.values import PoseSpec, Refers, Value
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, flow_text

SignalType: TypeAlias = Literal["boolean", "integer", "number", "text", "vector"]
ZoneName: TypeAlias = Annotated[str, Refers(("zone",))]
"""The name of a zone of the file."""

SignalName: TypeAlias = Annotated[str, Refers(("signal",))]
"""The name of a signal of the file."""

RendezvousName: TypeAlias = Annotated[str, Refers(("rendezvous",))]
"""The name of a rendezvous of the file."""

_Arms: TypeAlias = Annotated[tuple[Name, ...], Field(min_length=1, max_length=16)]
_Extent: TypeAlias = Annotated[float, Field(ge=1e-3, le=20.0)]
_ZONE_SIZES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("x", "y", "z"),
    "cylinder": ("radius", "height"),
}


class CellSignal(Value):
    """A value that some arms write and others wait for."""

    type: SignalType = port(..., "Type of its values")
    written_by: _Arms = port(..., "Arms whose trees may write it")
    initial: Data = port(None, "Value before the first write; by default none")

    def complaints(self, value: Data) -> list[str]:
        """Returns every reason why ``value`` cannot be the signal's value."""
        return ParamSpec(type=self.type).complaints("value", value)

    @model_validator(mode="after")
    def _initial_has_the_type(self) -> Self:
        if self.initial is not None:
            for complaint in self.complaints(self.initial):
                raise ValueError(f"initial: {complaint.removeprefix('value: ')}")
        return self


class Region(Value):
    """A region of space."""

    shape: Literal["box", "cylinder"] = port("box", "Shape, which determines the meaning of `size`")
    size: Annotated[tuple[_Extent, ...], Field(min_length=2, max_length=3)] = port(
        ..., "Box: x, y, z; cylinder: radius, height", unit="m"
    )
    pose: PoseSpec = port(
        PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its center in the world, or in the object's frame"
    )

    @model_validator(mode="after")
    def _size_fits_shape(self) -> Self:
        meaning = _ZONE_SIZES[self.shape]
        if len(self.size) != len(meaning):
            wanted = ", ".join(meaning)
            raise ValueError(f"the size of a {self.shape} is [{wanted}], not {list(self.size)}")
        return self

    def outside_by(self, point: Vector) -> float:
        """Returns the distance in m of a point outside the zone, 0 inside.

        Args:
            point: Position in the frame of the zone, of shape (3,), m.
        """
        if self.shape == "box":
            beyond = np.abs(point) - 0.5 * np.asarray(self.size)
        else:
            radius, height = self.size
            beyond = np.array([np.hypot(point[0], point[1]) - radius, abs(point[2]) - 0.5 * height])
        return float(np.linalg.norm(np.maximum(beyond, 0.0)))

    @property
    def edges(self) -> Vector:
        """Edges of the box around it, in its frame, of shape (3,), m."""
        if self.shape == "box":
            return np.asarray(self.size, float)
        radius, height = self.size
        return np.array((2.0 * radius, 2.0 * radius, height))

    def may_cross(self, start: Vector, direction: Vector) -> bool:
        """Returns whether a ray crosses the box around the region.

        Args:
            start: Start of the ray in the frame of the region, of shape (3,), m.
            direction: Its direction there, of shape (3,).
        """
        slopes = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
        ends = np.sort(
            np.stack((-0.5 * self.edges - start, 0.5 * self.edges - start)) / slopes, axis=0
        )
        return bool(max(float(ends[0].max()), 0.0) <= float(ends[1].min()))


class CellZone(Region):
    """A region that one arm at a time may claim."""

    around: str | None = port(None, "Object that it moves with")


RegionOrZone: TypeAlias = Annotated[
    Annotated[ZoneName, Tag("name")] | Annotated[Region, Tag("value")], Discriminator(written_as)
]
"""A zone of the cell by name, or a region of the world."""


Participants: TypeAlias = Annotated[tuple[Name, ...], Field(min_length=2, max_length=16)]
_Most: Final = 200

_MOST_STEPS: Final = 20_000
"""Limit on the search steps for claims that block each other: a hostile file could need many."""


class CellSpec(Value):
    """What the trees of a file share."""

    signals: Annotated[dict[Name, CellSignal], Field(max_length=_Most)] = port(
        {}, "Values that some arms write and others wait for, by name"
    )
    zones: Annotated[dict[Name, CellZone], Field(max_length=_Most)] = port(
        {}, "Regions that one arm at a time may claim, by name"
    )
    rendezvous: Annotated[dict[Name, Participants], Field(max_length=_Most)] = port(
        {}, "Points at which arms wait for each other: the names of the participants, by name"
    )


CATEGORIES: Final[Mapping[str, str]] = {
    "signal": "signals",
    "zone": "zones",
    "rendezvous": "rendezvous",
}
"""Section of the cell that declares the names of each category."""

SIGNAL: Final = "signal"
AWAIT: Final = "await"
MEET: Final = "meet"
CLAIM: Final = "claim"
IN_STEP: Final = "in_step"
IN_ZONE: Final = "in_zone"
"""Names of the node types that use the cell."""


def claimed(ports: Mapping[str, Data]) -> list[str]:
    """Returns what a claim claims, ``zone NAME`` or ``object NAME``, in the fixed global order."""
    found = []
    for category in ("object", "zone"):
        names = ports.get(category)
        items = names if isinstance(names, (list, tuple)) else (names,)
        found += [
            f"{category} {name}" for name in items if isinstance(name, str) and not is_dynamic(name)
        ]
    return sorted(found)


# Checks that need all trees of a file.


@dataclass(frozen=True)
class _Nested:
    """A claim within another one of the same arm: it waits for one thing and holds the other."""

    arm: str
    holds: str
    wants: str
    outer: NodeSpec
    inner: NodeSpec


@dataclass
class CellCheck:
    """Checks how the trees of one file use its cell.

    Args:
        source: The file.
        cell: Its cell.
        objects: Names of its objects.
        trees: Tree of each arm, by the arm's name.
        node_types: Node types by name.
        also_used: Category and name of what the rest of the file uses.
        is_sound: Whether a node has no errors of its own: these may be why no other node fits it.
    """

    source: Source
    cell: CellSpec
    objects: frozenset[str]
    trees: Mapping[str, NodeSpec]
    node_types: Mapping[str, NodeType]
    also_used: frozenset[tuple[str, str]] = frozenset()
    is_sound: Callable[[NodeSpec], bool] = lambda _: True

    def problems(self) -> Iterator[Problem]:
        """Returns every error."""
        yield from self._declarations()
        for arm, root in self.trees.items():
            for node in root.walk():
                yield from self._own_arm(arm, node)
                yield from self._node(arm, node)
                yield from self._counterpart(arm, node)
        never = [*self._never_written(), *self._unreachable()]
        yield from never
        if not never:
            yield from self._deadlocks()

    def warnings(self) -> Iterator[Problem]:
        """Returns warnings of what is declared and not used."""
        used = {
            (category, value)
            for root in self.trees.values()
            for node in root.walk()
            for category, value in self._names_in(node)
        }
        for category, section in CATEGORIES.items():
            for name in getattr(self.cell, section):
                if (category, name) not in used | self.also_used:
                    problem = self.source.problem(
                        ("cell", section, name), f"nothing uses the {category} '{name}'", key=True
                    )
                    yield replace(problem, severity="warning")

    def _names_in(self, node: NodeSpec) -> Iterator[tuple[str, str]]:
        by_kind = {
            SIGNAL: ("signal", "signal"),
            AWAIT: ("signal", "signal"),
            MEET: ("rendezvous", "at"),
        }
        if node.kind in by_kind:
            category, field = by_kind[node.kind]
            yield category, str(node.ports.get(field))
        elif node.kind == CLAIM:
            for resource in claimed(node.ports):
                category, _, name = resource.partition(" ")
                yield category, name
        elif node.kind in self.node_types:
            for port, info in self.node_types[node.kind].ports.model_fields.items():
                refers = metadata_of(info, Refers)
                if refers is not None:
                    yield from ((each, str(node.ports.get(port))) for each in refers.to)

    def _declarations(self) -> Iterator[Problem]:
        for name, signal in self.cell.signals.items():
            yield from self._arms(("cell", "signals", name, "written_by"), signal.written_by)
        for name, participants in self.cell.rendezvous.items():
            path = ("cell", "rendezvous", name)
            yield from self._arms(path, participants)
            for index, arm in enumerate(participants):
                if arm in participants[:index]:
                    yield self.source.problem((*path, index), f"'{arm}' is named twice")
        for name, zone in self.cell.zones.items():
            if zone.around is not None and zone.around not in self.objects:
                message = f"there is no object '{zone.around}'"
                hint = suggestion(zone.around, self.objects, "object")
                yield self.source.problem(("cell", "zones", name, "around"), message, hint)

    def _arms(self, path: DataPath, names: Sequence[str]) -> Iterator[Problem]:
        for index, name in enumerate(names):
            if name not in self.trees:
                hint = suggestion(name, self.trees, "arm")
                yield self.source.problem((*path, index), f"there is no arm '{name}'", hint)

    def _own_arm(self, arm: str, node: NodeSpec) -> Iterator[Problem]:
        """Returns the errors of ports that name the arm itself instead of another one."""
        node_type = self.node_types.get(node.kind)
        for name, info in node_type.ports.model_fields.items() if node_type else ():
            refers = metadata_of(info, Refers)
            if refers is not None and refers.to_others and node.ports.get(name) == arm:
                others = [other for other in self.trees if other != arm]
                hint = f"name another arm: {_listed(others)}" if others else ""
                message = f"{node.kind}: {name}: {arm} is the arm of this tree"
                yield node.port_problem((name,), message, hint)

    def _node(self, arm: str, node: NodeSpec) -> Iterator[Problem]:
        """Returns the errors of one node that follow from which arm it belongs to."""
        if node.kind in (SIGNAL, AWAIT):
            name = node.ports.get("signal")
            signal = self.cell.signals.get(name) if isinstance(name, str) else None
            if signal is None:
                return
            if node.kind == SIGNAL and arm not in signal.written_by:
                message = f"{SIGNAL}: '{name}' is not written by {arm}"
                hint = f"it is written by {_listed(signal.written_by)}: see cell.signals"
                yield node.port_problem(("signal",), message, hint)
            value = "value" if node.kind == SIGNAL else "to"
            if value in node.ports and not is_dynamic(node.ports[value]):
                for complaint in signal.complaints(node.ports[value]):
                    what = complaint.removeprefix("value: ")
                    yield node.port_problem(
                        (value,), f"{node.kind}: {value}: {what}: '{name}' is {_a(signal.type)}"
                    )
            elif value not in node.ports and signal.type != "boolean":
                message = f"{node.kind}: '{name}' is {_a(signal.type)}: {value} is missing"
                hint = "only a boolean signal has a default: true"
                if node.ports.get("relation") != "any":
                    yield node.port_problem((), message, hint, key=True)
        elif node.kind == CLAIM and not claimed(node.ports):
            message = f"{CLAIM}: claims nothing"
            yield node.port_problem((), message, "zone: NAME, object: NAME, or both", key=True)
        elif node.kind == IN_STEP:
            yield from self._partner(arm, node)
        elif node.kind == IN_ZONE:
            zone = self.cell.zones.get(str(node.ports.get("zone")))
            if zone is not None and zone.around is not None:
                message = f"{IN_ZONE}: '{node.ports['zone']}' moves with {zone.around}"
                hint = "no sensor gives its pose: name a zone that does not move"
                yield node.port_problem(("zone",), message, hint)
        elif node.kind == MEET:
            name = node.ports.get("at")
            participants = self.cell.rendezvous.get(name, ()) if isinstance(name, str) else ()
            if participants and arm not in participants:
                message = f"{MEET}: {arm} is not a participant of '{name}'"
                hint = f"its participants are {_listed(participants)}: see cell.rendezvous"
                yield node.port_problem(("at",), message, hint)

    def _partner(self, arm: str, node: NodeSpec) -> Iterator[Problem]:
        """Returns the error of an arm that goes in step with one that does not with it."""
        other = node.ports.get("with")
        if other == arm:
            yield node.port_problem(("with",), f"{IN_STEP}: {arm} cannot go in step with itself")
        elif isinstance(other, str) and other in self.trees:
            theirs = [
                below.ports.get("with")
                for below in self.trees[other].walk()
                if below.kind == IN_STEP
            ]
            if arm not in theirs and self._lacks(other, IN_STEP):
                message = f"{IN_STEP}: {other} never goes in step with {arm}"
                hint = f"its tree has no 'in_step: {{with: {arm}, child: …}}'"
                yield node.port_problem(("with",), message, hint)

    def _counterpart(self, arm: str, node: NodeSpec) -> Iterator[Problem]:
        """Returns the errors of a joint skill without a fitting leaf in a partner's tree."""
        node_type = self.node_types.get(node.kind)
        joint = None if node_type is None else node_type.counterpart
        given = None if joint is None else node.ports.get(joint.partner)
        if joint is None or given is None or is_dynamic(given):
            return
        partners = joint.partners(node.ports)
        if arm in partners:
            message = f"{node.kind}: {joint.partner}: {arm} cannot be its own partner"
            others = [name for name in self.trees if name != arm]
            hint = f"name another arm: {_listed(others)}" if others else ""
            yield node.port_problem((joint.partner,), message, hint)
            return
        # If several arms share one joint skill, each leaf names all others.
        members = frozenset({arm, *partners})
        same = {name: node.ports.get(name) for name in joint.same}
        if any(map(is_dynamic, same.values())) or not self.is_sound(node):
            return
        acting = [node]
        is_complete = True
        for partner in partners:
            if partner not in self.trees:
                return  # another check reports it
            leaves = [one for one in self.trees[partner].walk() if one.kind == joint.kind]
            theirs = members - {partner}
            fitting = [leaf for leaf in leaves if _fits(leaf, joint, theirs, same)]
            if not fitting and self._lacks(partner, joint.kind):
                yield self._misfit(node, joint, partner, theirs, leaves)
            is_complete &= bool(fitting)
            acting += fitting
        if not is_complete:
            return  # a leaf that is not there may be the one with these ports
        # One leaf reports for all: that of the first arm of the file.
        is_first = arm == next(name for name in self.trees if name in members)
        given = any(leaf.ports.get(name) is not None for leaf in acting for name in joint.by_one)
        if joint.by_one and is_first and not given:
            ports = " or ".join(f"'{name}'" for name in joint.by_one)
            message = f"{node.kind}: no leaf of {_listed(sorted(members))} has {ports}"
            hint = "one of them needs it, as the goal of all"
            yield node.port_problem((), message, hint, key=True)

    def _lacks(self, arm: str, kind: str) -> bool:
        """Whether no error in an arm's tree may be why it has no fitting node of a kind."""
        suspects = []
        for node in self.trees[arm].walk():
            node_type = self.node_types.get(node.kind)
            is_empty = node_type is not None and not (node_type.is_leaf or node.children)
            if node.kind == kind or not node.whole or node_type is None or is_empty:
                suspects.append(node)
        return all(map(self.is_sound, suspects))

    def _misfit(
        self,
        node: NodeSpec,
        joint: Counterpart,
        partner: str,
        theirs: frozenset[str],
        leaves: Sequence[NodeSpec],
    ) -> Problem:
        """Returns the error of a partner none of whose leaves names ``theirs`` as its partners."""
        is_list = not isinstance(node.ports.get(joint.partner), str)
        same = {name: node.ports.get(name) for name in joint.same}
        members: Data = sorted(theirs) if is_list else next(iter(theirs))
        needed = flow_text({joint.its_partner: members, **same})
        message = f"{node.kind}: no '{joint.kind}' in the tree of {partner} fits this one"
        hint = f"it needs {joint.kind}: {needed}"
        if leaves:
            has = "; ".join(
                ", ".join(
                    f"{name}: {flow_text(leaf.ports.get(name))}"
                    for name in (joint.its_partner, *same)
                )
                + f" ({leaf.location})"
                for leaf in leaves[:3]
            )
            hint += f"; it has {has}"
        return node.port_problem((joint.partner,), message, hint)

    def _never_written(self) -> Iterator[Problem]:
        """Returns awaited signals without initial value that no tree of a writer writes."""
        written = [
            node.ports.get("signal")
            for root in self.trees.values()
            for node in root.walk()
            if node.kind == SIGNAL
        ]
        if any(map(is_dynamic, written)):
            return
        for root in self.trees.values():
            for node in root.walk():
                name = node.ports.get("signal")
                if node.kind != AWAIT or not isinstance(name, str):
                    continue
                signal = self.cell.signals.get(name)
                if signal is None or signal.initial is not None or name in written:
                    continue
                writers = [arm for arm in signal.written_by if arm in self.trees]
                if all(self._lacks(arm, SIGNAL) for arm in writers):
                    message = f"{AWAIT}: no tree writes '{name}', and it has no initial value"
                    hint = f"write it with 'signal' in the tree of {_listed(signal.written_by)}"
                    yield node.port_problem(("signal",), message, hint)

    def _unreachable(self) -> Iterator[Problem]:
        """Returns meetings that a participant never reaches."""
        for name, participants in self.cell.rendezvous.items():
            coming = {arm: [*self._meets(arm, name)] for arm in participants if arm in self.trees}
            if not any(coming.values()) or any(
                is_dynamic(node.ports.get("at"))
                for arm in coming
                for node in self.trees[arm].walk()
                if node.kind == MEET
            ):
                continue
            for arm, nodes in coming.items():
                if not nodes and self._lacks(arm, MEET):
                    there = next(node for nodes in coming.values() for node in nodes)
                    message = f"{MEET}: {arm} never reaches '{name}'"
                    hint = f"its tree has no 'meet: {name}'; or it is not a participant"
                    yield there.port_problem(("at",), message, hint)

    def _meets(self, arm: str, name: str) -> Iterator[NodeSpec]:
        for node in self.trees[arm].walk():
            if node.kind == MEET and node.ports.get("at") == name:
                yield node

    # Deadlocks

    def _deadlocks(self) -> Iterator[Problem]:
        nested = [one for arm, root in self.trees.items() for one in _nested(arm, root)]
        for one in nested:
            if one.holds == one.wants:
                message = f"{CLAIM}: {one.arm} waits here for '{one.wants}', which it has claimed"
                yield one.inner.problem(message, f"the claim around it is at {one.outer.location}")
        cycle = _cycle([one for one in nested if one.holds != one.wants])
        if cycle:
            steps = "; ".join(
                f"{one.arm} holds {one.holds} ({one.outer.location}) and claims {one.wants} "
                f"({one.inner.location})"
                for one in cycle
            )
            message = f"{CLAIM}: these claims can deadlock: {steps}"
            hint = "claim them in the same order, or together: claim: {zone: [a, b], child: …}"
            yield cycle[0].inner.problem(message, hint)
        yield from self._meetings_within_claims()
        if all(self._lacks(arm, kind) for arm in self.trees for kind in (MEET, SIGNAL)):
            yield from self._waits_for_good()

    def _meetings_within_claims(self) -> Iterator[Problem]:
        """Returns meetings that two participants can only come to while both hold the same."""
        for name, participants in self.cell.rendezvous.items():
            held = [
                (arm, [*_claims_around(self.trees[arm], self._meets(arm, name))])
                for arm in participants
                if arm in self.trees
            ]
            for index, (arm, claims) in enumerate(held):
                for other, others in held[index + 1 :]:
                    both = _in_all(claims) & _in_all(others)
                    if not both:
                        continue
                    resource = min(both)
                    node = claims[0][resource]
                    message = (
                        f"{CLAIM}: {arm} and {other} both hold {resource} when meeting at '{name}'"
                        f", which is impossible: {arm} claims it here, {other} at "
                        f"{others[0][resource].location}"
                    )
                    yield node.problem(message, "meet before the claim, or after it")

    def _waits_for_good(self) -> Iterator[Problem]:
        """Returns meetings and awaited signals that never come, as each arm waits for another.

        Only what every run does counts, as `LanguageNode.runs_all` defines. An arm whose tree does
        anything else at some point may do anything from there on.
        """
        ahead = {arm: _straight(root, self.node_types) for arm, root in self.trees.items()}
        waits = self._stalled({arm: nodes for arm, (nodes, _) in ahead.items()})
        finished = {arm for arm, (_, is_all) in ahead.items() if is_all and arm not in waits}
        stuck = {arm: node for arm, node in waits.items() if "timeout" not in node.ports}
        while True:  # an arm that waits for arms that may still come is not stuck
            blocked_by = {arm: self._blocked_by(arm, waits, finished | {*stuck}) for arm in stuck}
            if all(blocked_by.values()):
                break
            stuck = {arm: node for arm, node in stuck.items() if blocked_by[arm]}
        if stuck:
            steps = "; ".join(
                f"{arm} waits for {self._subject(node)} ({node.location}) of "
                f"{_listed(blocked_by[arm])}"
                + ("" if set(blocked_by[arm]) & set(stuck) else ", whose tree is over by then")
                for arm, node in stuck.items()
            )
            node = next(iter(stuck.values()))
            port_name = {MEET: "at", IN_STEP: "with"}.get(node.kind, "signal")
            message = f"{node.kind}: this wait never ends: {steps}"
            hint = (
                "meet equally often and in the same order, write before waiting, or set a timeout"
            )
            yield node.port_problem((port_name,), message, hint)

    def _subject(self, node: NodeSpec) -> str:
        if node.kind == MEET:
            return f"the meeting '{node.ports['at']}'"
        if node.kind == IN_STEP:
            return f"the step with {node.ports['with']}"
        return f"the signal '{node.ports['signal']}'"

    def _stalled(self, ahead: Mapping[str, Sequence[NodeSpec]]) -> dict[str, NodeSpec]:
        """Returns the node at which each arm waits once none can continue."""
        at = dict.fromkeys(ahead, 0)
        written = {name for name, one in self.cell.signals.items() if one.initial is not None}
        while True:
            waits = {arm: ahead[arm][at[arm]] for arm in ahead if at[arm] < len(ahead[arm])}
            passing = {
                arm
                for arm, node in waits.items()
                if node.kind == SIGNAL or (node.kind == AWAIT and node.ports["signal"] in written)
            }
            for arm, node in waits.items():
                name, participants = self._meeting(arm, node)
                if name and all(self._is_at(other, name, waits) for other in participants):
                    passing.add(arm)
            if not passing:
                return waits
            for arm in passing:
                if waits[arm].kind == SIGNAL:
                    written.add(str(waits[arm].ports["signal"]))
                at[arm] += 1

    def _is_at(self, arm: str, name: str, waits: Mapping[str, NodeSpec]) -> bool:
        return arm in waits and self._meeting(arm, waits[arm])[0] == name

    def _meeting(self, arm: str, node: NodeSpec) -> tuple[str, Sequence[str]]:
        """Returns the name and the participants of the meeting that a node waits for, if it does.

        Beginning and end of a step are meetings as well.
        """
        if node.kind == IN_STEP:
            first, second = sorted((arm, str(node.ports["with"])))
            return f"the step of {first} and {second}", (first, second)
        if node.kind == MEET:
            name = str(node.ports["at"])
            return name, self.cell.rendezvous.get(name, ())
        return "", ()

    def _blocked_by(self, arm: str, waits: Mapping[str, NodeSpec], halted: set[str]) -> list[str]:
        """Returns the arms for which a wait does not end; empty if it may end."""
        node = waits[arm]
        if node.kind == AWAIT:
            signal = self.cell.signals.get(str(node.ports["signal"]))
            writers = () if signal is None else signal.written_by
            return [*writers] if halted.issuperset(writers) else []
        name, participants = self._meeting(arm, node)
        missing = [other for other in participants if not self._is_at(other, name, waits)]
        return [other for other in missing if other in halted]


def _fits(
    leaf: NodeSpec, joint: Counterpart, theirs: frozenset[str], same: Mapping[str, Data]
) -> bool:
    """Whether a leaf of a partner names ``theirs`` as its partners, and has the ports ``same``."""
    named = leaf.ports.get(joint.its_partner)
    return (is_dynamic(named) or frozenset(names_in(named)) == theirs) and all(
        leaf.ports.get(name) == value or is_dynamic(leaf.ports.get(name))
        for name, value in same.items()
    )


def _listed(names: Iterable[str]) -> str:
    return " and ".join(names)


def _a(type_name: str) -> str:
    return f"{'an' if type_name[0] in 'aeiou' else 'a'} {type_name}"


def _nested(arm: str, root: NodeSpec) -> list[_Nested]:
    """Returns every pair of a claim and a claim within it, in the order of the file."""
    found: list[_Nested] = []
    waiting: list[tuple[NodeSpec, tuple[tuple[str, NodeSpec], ...]]] = [(root, ())]
    while waiting:
        node, around = waiting.pop()
        if node.kind == CLAIM:
            wanted = claimed(node.ports)
            found += [
                _Nested(arm, holds, wants, outer, node)
                for holds, outer in around
                for wants in wanted
            ]
            around = (*around, *((resource, node) for resource in wanted))
        waiting += [(child, around) for child in reversed(node.children)]
    return found


def _cycle(nested: Sequence[_Nested]) -> list[_Nested]:
    """Returns claims of different arms, of which each waits for what the next one holds.

    An arm does one thing after the other, so its own claims alone block nobody, and two of them
    are never active at the same time. Empty if there are none.
    """
    first_of = {(one.arm, one.holds, one.wants): one for one in reversed(nested)}
    edges = [*reversed(first_of.values())]
    left = _MOST_STEPS

    def search(path: list[_Nested]) -> list[_Nested]:
        nonlocal left
        left -= 1
        if path[-1].wants == path[0].holds and len(path) > 1:
            return path
        arms = {one.arm for one in path}
        for one in edges:
            if left > 0 and one.holds == path[-1].wants and one.arm not in arms:
                found = search([*path, one])
                if found:
                    return found
        return []

    for first in edges:
        found = search([first])
        if found:
            return found
    return []


def _claims_around(root: NodeSpec, nodes: Iterable[NodeSpec]) -> Iterator[dict[str, NodeSpec]]:
    """Returns for each of these nodes the claims that it is within, by what they claim."""
    wanted = set(map(id, nodes))
    waiting: list[tuple[NodeSpec, dict[str, NodeSpec]]] = [(root, {})]
    while waiting:
        node, around = waiting.pop()
        if id(node) in wanted:
            yield around
        if node.kind == CLAIM:
            around = around | dict.fromkeys(claimed(node.ports), node)
        waiting += [(child, around) for child in reversed(node.children)]


def _in_all(claims: Sequence[Mapping[str, NodeSpec]]) -> set[str]:
    return set.intersection(*(set(one) for one in claims)) if claims else set()


def _straight(root: NodeSpec, node_types: Mapping[str, NodeType]) -> tuple[list[NodeSpec], bool]:
    """Returns the nodes that use the cell and that every run comes to, in their order.

    The second value is whether those are all: False where the file does not determine what follows.
    """
    found: list[NodeSpec] = []

    def visit(node: NodeSpec) -> bool:
        if node.kind == IN_STEP:
            other = node.ports.get("with")
            if "timeout" in node.ports or not isinstance(other, str) or is_dynamic(other):
                return False
            if not node.children:
                return False  # an error of its own, as other arms are
            found.append(node)
            goes_on = visit(node.children[0])
            if goes_on:
                found.append(node)  # its end, which waits for the other arm as well
            return goes_on
        if node.kind in (MEET, AWAIT, SIGNAL):
            name = node.ports.get("at" if node.kind == MEET else "signal")
            if not isinstance(name, str) or is_dynamic(name):
                return False  # names that do not exist are reported by another check
            found.append(node)
            return "timeout" not in node.ports
        node_type = node_types.get(node.kind)
        if isinstance(node_type, LanguageNode) and node_type.runs_all(node):
            return all(visit(child) for child in node.children)
        return not any(below.kind in (MEET, AWAIT, SIGNAL, IN_STEP) for below in node.walk())

    return found, visit(root)
