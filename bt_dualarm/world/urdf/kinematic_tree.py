"""Who hangs on whom: the links and joints of one file, as a tree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from bt_dualarm.spec.problems import suggestion
from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.joint import Joint
from bt_dualarm.world.urdf.xml_source import Element


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Links by name, each but the root on one joint.

    Attributes:
        links: Elements of the links, by name, in the file's order.
        joints: Joints by name, in the file's order.
        above: Joint that a link hangs on, by the link's name; none for the root.
        below: Joints that hang on a link, by the link's name, in the file's order.
    """

    links: Mapping[str, Element]
    joints: Mapping[str, Joint]
    above: Mapping[str, Joint]
    below: Mapping[str, Sequence[Joint]]

    @property
    def root(self) -> str:
        """The link that hangs on none."""
        return next(link for link in self.links if link not in self.above)

    def subtree(self, link: str) -> Iterator[str]:
        """A link and all that hang on it, each after the one that it hangs on."""
        waiting = [link]
        while waiting:
            link = waiting.pop()
            yield link
            waiting += [joint.child for joint in reversed(self.below.get(link, ()))]

    def chain(self, base: str, tip: str) -> tuple[Joint, ...] | None:
        """The joints from a link down to another; None if the other does not hang on it."""
        joints: list[Joint] = []
        while tip != base:
            joint = self.above.get(tip)
            if joint is None:
                return None
            joints.append(joint)
            tip = joint.parent
        return tuple(reversed(joints))


def tree_of(
    links: Mapping[str, Element], joints: Sequence[Joint], complaints: Complaints
) -> KinematicTree:
    """The tree that joints make of links, with a complaint wherever they make none."""
    above: dict[str, Joint] = {}
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        if not _is_known(joint, links, complaints):
            continue
        if joint.child in above:
            first = above[joint.child]
            message = f"link '{joint.child}' hangs on '{joint.name}' and on '{first.name}'"
            hint = f"a link hangs on one joint; the other is in line {first.element.line}"
            complaints.add(joint.element, message, hint)
            continue
        above[joint.child] = joint
        below.setdefault(joint.parent, []).append(joint)
    tree = KinematicTree(links, {joint.name: joint for joint in joints}, above, below)
    if not complaints.problems:
        _refuse_more_than_one_tree(tree, complaints)
    return tree


def _is_known(joint: Joint, links: Mapping[str, Element], complaints: Complaints) -> bool:
    """Whether both links of a joint are there."""
    known = True
    for tag, name in (("parent", joint.parent), ("child", joint.child)):
        if name not in links:
            known = False
            if name:  # without a name there was a complaint already
                end = joint.element.find(tag) or joint.element
                hint = suggestion(name, links, "link")
                complaints.add(end, f"there is no link '{name}'", hint, "link")
    return known


def _refuse_more_than_one_tree(tree: KinematicTree, complaints: Complaints) -> None:
    """One root, and every link below it: what is not hangs on itself."""
    roots = [link for link in tree.links if link not in tree.above]
    for root in roots[1:]:
        message = f"links '{roots[0]}' and '{root}' both hang on nothing"
        complaints.add(tree.links[root], message, "a joint is missing: all links are one tree")
    reached = {link for root in roots for link in tree.subtree(root)}
    circling = [link for link in tree.links if link not in reached]
    if circling:
        names = ", ".join(f"'{link}'" for link in circling[:8])
        more = ", …" if len(circling) > 8 else ""
        joint = tree.above[circling[0]]
        message = f"joint '{joint.name}' closes a circle: {names}{more} hang on one another"
        complaints.add(joint.element, message, "links and joints are a tree")
