"""The arm in a URDF: the chain for PlaCo and MuJoCo, limits, and the shapes of its links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.joint import Stops
from bt_dualarm.world.urdf.kinematic_text import kinematic_text
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.link import MeshFinder, Shape
from bt_dualarm.world.urdf.part import Part, Selection, parts_of
from bt_dualarm.world.urdf.rigid_body import fused, with_solid_bodies


@dataclass(frozen=True, eq=False)
class Urdf:
    """What a URDF says of one arm, whose joints are either its own or locked.

    Attributes:
        parts: Its links by name, each after the one that it hangs on.
    """

    parts: Mapping[str, Part]

    @classmethod
    def read(
        cls,
        tree: KinematicTree,
        selection: Selection,
        mesh_file: MeshFinder,
        complaints: Complaints,
    ) -> Urdf:
        """What hangs on the base, as far as it is needed; of no use after a complaint.

        Args:
            tree: Links and joints of the file.
            selection: What of them makes the arm.
            mesh_file: Finder of the meshes that shapes name.
            complaints: List that takes what is wrong.
        """
        parts = parts_of(tree, selection, mesh_file, complaints)
        parts = with_solid_bodies(parts, tree, complaints)
        return cls(fused(_that_touch(parts, tree, complaints), selection.named))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, each after the one that it hangs on."""
        return tuple(self.parts)

    @property
    def stops(self) -> Mapping[str, Stops]:
        """Limits of the arm's joints by name."""
        return {
            part.joint.name: part.stops
            for part in self.parts.values()
            if part.joint is not None and part.stops is not None
        }

    @cached_property
    def kinematic_text(self) -> str:
        """A URDF of the arm without shapes."""
        return kinematic_text(tuple(self.parts.values()))

    def shapes(self, link: str, tag: str) -> tuple[Shape, ...]:
        """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
        part = self.parts[link]
        return part.visual if tag == "visual" else part.collision


def _that_touch(
    parts: Mapping[str, Part], tree: KinematicTree, complaints: Complaints
) -> Mapping[str, Part]:
    """The parts; where a URDF has no shapes to touch with, those that are seen stand for them."""
    base = next(iter(parts))
    moving = [part for part in parts.values() if part.top != base]
    if any(part.collision for part in moving):
        return parts
    if any(part.visual for part in moving):
        return {link: replace(part, collision=part.visual) for link, part in parts.items()}
    if moving and not complaints.problems:
        hint = "give the links a <collision>: without, nothing keeps the arm from hitting things"
        complaints.add(tree.links[moving[0].link], "no link that moves has a shape", hint)
    return parts
