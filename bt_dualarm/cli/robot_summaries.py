"""Robots in the terminal: the catalogue at a glance, and one robot whole."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.sheets import escape, print_json, print_parts, table

if TYPE_CHECKING:
    from bt_dualarm.motion.kinematics.robot_summary import RobotSummary


def list_robots(*, as_json: bool) -> None:
    """The catalogue: a line for each robot with its joints' number, reach, postures and mounts."""
    from bt_dualarm.world.robots.catalogue import robot_names

    summaries = [_summary(name) for name in robot_names()]
    if as_json:
        print_json({summary.name: asdict(summary) for summary in summaries})
        return
    rows = (
        (
            summary.name,
            summary.title,
            str(len(summary.joints)),
            f"{summary.reach_m:.2f} m",
            ", ".join(posture.name for posture in summary.postures),
            ", ".join(mount.name for mount in summary.cameras),
        )
        for summary in summaries
    )
    titles = ("robot", "", "joints", "reach", "postures", "camera mounts")
    print_parts("robots:", table(titles, rows), "\nbt-skills NAME shows one robot whole.")


def show_robot(name: str, *, as_json: bool) -> None:
    """One robot, of the catalogue or of a page: joints, postures, camera mounts, tool, reach.

    Raises:
        CatalogueError: There is none, or its page is wrong.
    """
    from bt_dualarm.motion.kinematics.robot_summary import direction, numbers

    summary = _summary(name)
    if as_json:
        print_json(asdict(summary))
        return
    joints = (
        (j.name, f"{j.lower_deg:g}°", f"{j.upper_deg:g}°", f"{j.velocity_deg_s:g} °/s")
        for j in summary.joints
    )
    postures = (
        (p.name, numbers(p.angles_deg), numbers(p.tool_m), direction(p.points))
        for p in summary.postures
    )
    mounts = ((c.name, c.link, numbers(c.xyz_m), direction(c.looks)) for c in summary.cameras)
    tool = f"({numbers(summary.tool_m)}) m in {escape(summary.tool_link)}, its z axis out of it"
    print_parts(
        f"[bold]{escape(summary.name)}[/bold]  {escape(summary.title)}",
        "\njoints, base to tip:",
        table(("joint", "from", "to", "velocity"), joints),
        "\npostures, the tool as seen from the base link:",
        table(("posture", "angles in degrees", "tool at, m", "points"), postures),
        *(
            ("\ncamera mounts:", table(("mount", "in the link", "at, m", "looks"), mounts))
            if summary.cameras
            else ()
        ),
        f"\ntool: at {tool}",
        f"reach: {summary.reach_m:.2f} m from the first joint, at ({numbers(summary.centre_m)}) m",
        *(() if summary.payload_kg is None else (f"payload: {summary.payload_kg:g} kg",)),
    )


def _summary(name: str) -> RobotSummary:
    from bt_dualarm.motion.kinematics.robot_summary import robot_summary
    from bt_dualarm.world.robots.catalogue import load_robot
    from bt_dualarm.world.robots.page_path import is_page

    if is_page(name):
        page = Path(name)
        return robot_summary(load_robot(page.name, page.parent))
    return robot_summary(load_robot(name))
