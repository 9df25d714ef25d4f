"""Grippers in the terminal: the catalogue at a glance, and one gripper whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.sheets import escape, print_json, print_parts, table

if TYPE_CHECKING:
    from bt_dualarm.world.grippers.gripper import Gripper, Span


def list_grippers(*, as_json: bool) -> None:
    """The catalogue: a line for each gripper with its stroke, force, payload and mass."""
    from bt_dualarm.world.grippers.named import gripper_names

    grippers = [_load(name) for name in gripper_names()]
    if as_json:
        print_json({gripper.name: _sheet(gripper) for gripper in grippers})
        return
    rows = map(_row, grippers)
    titles = ("gripper", "", "stroke", "force", "payload", "mass")
    print_parts("grippers:", table(titles, rows), "\nbt-skills NAME shows one gripper whole.")


def _row(gripper: Gripper) -> tuple[str, ...]:
    return (
        gripper.name,
        gripper.title,
        f"{1e3 * gripper.stroke:g} mm" if gripper.fingers else "vacuum",
        _span(gripper.force, 1.0, "N"),
        f"{gripper.payload:g} kg",
        f"{gripper.mass:.3g} kg",
    )


def show_gripper(name: str, *, as_json: bool) -> None:
    """One gripper, of the catalogue or of a page: what it can do, and where its tool frame is.

    Raises:
        CatalogueError: There is none, or its page is wrong.
    """
    gripper = _load(name)
    if as_json:
        print_json(_sheet(gripper))
        return
    print_parts(
        f"[bold]{escape(gripper.name)}[/bold]  {escape(gripper.title)}\n",
        *(_fingers(gripper) if gripper.fingers else _cup(gripper)),
        f"payload: {gripper.payload:g} kg, or what the robot has left",
        f"mass: {gripper.mass:.3g} kg",
        f"tool: {_tool(gripper)}",
    )


def _fingers(gripper: Gripper) -> tuple[str, ...]:
    return (
        "takes hold by: two fingers",
        f"stroke: {1e3 * gripper.stroke:g} mm",
        f"speed: {_span(gripper.speed, 1e3, 'mm/s')} of both fingers together",
        f"force: {_span(gripper.force, 1.0, 'N')} of each pad",
        f"encoder: a step of {1e3 * gripper.resolution:g} mm",
        f"pads: {_pads(gripper)}",
    )


def _pads(gripper: Gripper) -> str:
    felt = gripper.tactile
    if felt is None:
        return "do not feel"
    return f"feel the force on them {felt.rate:g} times a second, within {felt.noise:g} N"


def _cup(gripper: Gripper) -> tuple[str, ...]:
    return "takes hold by: vacuum", f"force: {_span(gripper.force, 1.0, 'N')} that pulls it off"


def _tool(gripper: Gripper) -> str:
    x, y, z = (gripper.mount @ gripper.tool).position
    return f"at ({x:.3f}, {y:.3f}, {z:.3f}) m from the flange, its z axis out of the gripper"


def is_gripper_page(name: str) -> bool:
    """Whether a file describes a gripper: every one has a palm, and no robot has."""
    import yaml

    try:
        page = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return False
    return isinstance(page, dict) and "palm" in page


def _load(name: str) -> Gripper:
    from bt_dualarm.world.grippers.named import load_gripper
    from bt_dualarm.world.robots.page_path import is_page

    if is_page(name):
        page = Path(name)
        return load_gripper(page.name, page.parent)
    return load_gripper(name)


def _sheet(gripper: Gripper) -> dict[str, object]:
    """What a program reads, SI units."""
    return {
        "name": gripper.name,
        "title": gripper.title,
        "kind": gripper.kind,
        "stroke_m": gripper.stroke,
        "force_n": [gripper.force.least, gripper.force.most],
        "speed_m_s": [gripper.speed.least, gripper.speed.most],
        "payload_kg": gripper.payload,
        "mass_kg": gripper.mass,
        "resolution_m": gripper.resolution,
        "tactile_hz": None if gripper.tactile is None else gripper.tactile.rate,
        "friction": gripper.friction,
        "tool_m": (gripper.mount @ gripper.tool).position.tolist(),
    }


def _span(span: Span, times: float, unit: str) -> str:
    return f"{times * span.least:g} to {times * span.most:g} {unit}"
