"""Write the page of all robots and scenes, ``robots.md``, from the catalog."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import yaml

from bt_dualarm.cli.bt_skills import RobotSummary, direction, numbers, robot_summary
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.sim.composition import scene_names

PAGE: Final = Path(__file__).with_suffix(".md")

_HEAD: Final = """\
# Robots and scenes

Values of `robot`, `posture`, `mount` and `scene` in a tree file. Generated from the catalog by
`make docs`. `bt-skills robots` and `bt-skills ur5` print the same in a terminal, and
`bt-skills z1.yaml` prints your own description ([how to write one](own_robot.md)).
"""

_ROBOTS: Final = """\
Positions and directions are relative to the base link, which `base` of the file positions: with
`base: {xyz: [0, 0, 0.4]}`, add 0.4 m to every height. The tool points along its z axis. Reach is
the largest distance of the tool from the first joint within the joint limits, found by local search
from several configurations. Nothing beyond it is reachable, and not every pose within it is;
`bt-check` warns of poses that are not. [Motion](motion.md#sources-of-the-limits) lists the limits
of acceleration and jerk with their sources. [What each robot can do](robot_skills.md) has
every skill.
"""

_LOCKED: Final = """\
Joints that are not part of the arm are locked during a run. `locked` of an arm in a tree file sets
their positions by name; coupled joints follow:
"""

_SCENES: Final = """\
## Scenes

Coordinates are meters in the world. The center of an object on a surface is half its height above
it: a cube of 0.05 m on a top at 0.4 m is at `z: 0.425`. Skills, poses and goals cannot name these
parts, only objects of the tree and fixtures of a
[scene of your own](objects.md#a-scene-of-your-own).
"""


def robots_page() -> str:
    """The whole page."""
    summaries = [robot_summary(load_robot(name)) for name in robot_names()]
    parts = [_HEAD, _overview(summaries), _ROBOTS]
    for summary in summaries:
        parts += _robot(summary)
    parts.append(_SCENES)
    for name in scene_names():
        parts += [f"### {name}\n", _table(("part", "shape", "x", "y", "z"), _parts(name))]
    return "\n".join(parts).rstrip() + "\n"


def _overview(summaries: Iterable[RobotSummary]) -> str:
    return _table(
        ("robot", "", "joints", "reach", "postures", "camera mounts"),
        (
            (
                f"[`{summary.name}`](#{summary.name})",
                summary.title,
                str(len(summary.joints)),
                f"{summary.reach_m:.2f} m",
                _codes(posture.name for posture in summary.postures),
                _codes(mount.name for mount in summary.cameras),
            )
            for summary in summaries
        ),
    )


def _robot(summary: RobotSummary) -> Iterator[str]:
    payload = "" if summary.payload_kg is None else f" It may hold {summary.payload_kg:g} kg."
    yield f"## {summary.name}\n"
    yield (
        f"{summary.title}. Its tool reaches {summary.reach_m:.2f} m from the first joint, which is "
        f"at ({numbers(summary.center_m)}) m from the base link, `{summary.base_link}`. The tool "
        f"frame is at ({numbers(summary.tool_m)}) m in the link `{summary.tool_link}`."
        f"{payload}{_corrections(summary.name)}\n"
    )
    yield _table(
        ("joint", "from", "to", "velocity"),
        (
            (f"`{j.name}`", f"{j.lower_deg:g}°", f"{j.upper_deg:g}°", f"{j.velocity_deg_s:g} °/s")
            for j in summary.joints
        ),
    )
    yield _table(
        ("posture", "angles in degrees", "tool at, m", "points along"),
        (
            (f"`{p.name}`", numbers(p.angles_deg), numbers(p.tool_m), direction(p.points))
            for p in summary.postures
        ),
    )
    yield _table(
        ("camera mount", "in the link", "at, m", "looks along, in the link"),
        (
            (f"`{c.name}`", f"`{c.link}`", numbers(c.xyz_m), direction(c.looks))
            for c in summary.cameras
        ),
    )
    if summary.locked:
        yield _LOCKED
        yield _table(
            ("locked joint", "position", "range", "coupled to"),
            (
                (
                    f"`{j.name}`",
                    f"{j.at:g} {j.unit}",
                    f"{j.lower:g} to {j.upper:g} {j.unit}",
                    "" if j.follows is None else f"`{j.follows}`",
                )
                for j in summary.locked
            ),
        )


def _corrections(robot: str) -> str:
    """Which figures of the URDF its description replaces, and their source."""
    path = share_dir("assets") / "robots" / f"{robot}.yaml"
    entry = yaml.safe_load(path.read_text(encoding="utf-8"))
    if "corrections" not in entry:
        return ""
    source = entry["corrections"]["source"]
    return (
        f" Values of its URDF, `{entry['urdf']}`, are "
        f"[corrected](own_robot.md#corrections-of-the-urdf). Source: {source}."
    )


def _parts(scene: str) -> Iterator[tuple[str, ...]]:
    """Each shape of a scene, and from where to where it goes along the world's axes."""
    model = mujoco.MjModel.from_xml_path(str(share_dir("assets") / "scenes" / f"{scene}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for number in range(model.ngeom):
        shape = mujoco.mjtGeom(model.geom_type[number])
        words = (f"`{model.geom(number).name}`", shape.name.removeprefix("mjGEOM_").lower())
        if shape == mujoco.mjtGeom.mjGEOM_PLANE:
            yield (*words, "everywhere", "everywhere", f"{data.geom_xpos[number][2]:g}")
        else:
            yield (*words, *_spans(model, data, number))


def _spans(model: Any, data: Any, geom: int) -> Iterator[str]:
    turned = data.geom_xmat[geom].reshape(3, 3)
    middle = data.geom_xpos[geom] + turned @ model.geom_aabb[geom, :3]
    half = np.abs(turned) @ model.geom_aabb[geom, 3:]
    for least, most in np.round(np.stack((middle - half, middle + half), axis=1), 3) + 0.0:
        yield f"{least:g} to {most:g}"


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    titles = list(head)
    lines = [titles, ["---"] * len(titles), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main() -> None:
    """Write the page."""
    PAGE.write_text(robots_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
