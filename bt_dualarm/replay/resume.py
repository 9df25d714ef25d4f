"""A run that goes on from a time of a record: its past is made again, and must be the same."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from bt_dualarm.replay.known_pictures import known_pictures
from bt_dualarm.replay.past import Past
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.rerun import Changed, Remade, differences, made_anew
from bt_dualarm.replay.timeline import Node, Timeline, node_of
from bt_dualarm.runtime.history_start import tree_facts
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.sights import KnownPicture
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node import NodeSpec

_AT_A_TIME_S = 0.1

_log = logging.getLogger(__name__)


class PastChangedError(ReplayError):
    """The past of a run is not that of the record; says at which node."""


def resumed(
    record: Record,
    time: float,
    registry: Registry,
    changed: Changed,
    stop: StopRequest | None = None,
) -> Run:
    """Run the past again, at full speed, checking every step; then hand it over.

    What was found in its pictures stands in the record; they are drawn where that leads elsewhere.

    Args:
        record: The record.
        time: Simulated time in s from which it is to go on.
        registry: The skills.
        changed: Another tree, whose past must be the same, and options.
        stop: Request to end early.

    Returns:
        The run at that time; its hash is that of a run that was never interrupted.

    Raises:
        PastChangedError: A step or a status until then is another one; says which, and why.
        ReplayError: The time is outside of the record.
        DualArmError: The run cannot be made.
    """
    timestep = float(record.start["timestep"])
    steps, last = round(time / timestep), record.steps * timestep
    if not 0 < steps <= record.steps:
        raise ReplayError(f"cannot resume at {time:g} s: the record goes from 0 to {last:.2f} s")
    stop = stop or StopRequest()
    changed = replace(changed, includes=True)
    known = known_pictures(record, (steps - 0.5) * timestep)
    for pictures in (known, {}):
        remade = made_anew(record, registry, changed, stop)
        try:
            past = _relived(record, remade.run, steps, stop, pictures)
            if past.steps == steps or stop.asked:
                return remade.run
            _refuse_unless_pictures_do(record, remade, past, registry)
        except BaseException:
            remade.run.close()
            raise
        remade.run.close()
    raise AssertionError("no picture is taken from where there are none")


def _refuse_unless_pictures_do(
    record: Record, remade: Remade, past: Past, registry: Registry
) -> None:
    """Say so where pictures that were not drawn may be the reason; else there is no other try.

    Raises:
        PastChangedError: The past is another one.
    """
    time = past.steps * float(record.start["timestep"])
    if any(edited(record, remade.trees, time)) or not _took_pictures(remade.run):
        raise PastChangedError(_explained(record, remade, past, registry))
    _log.warning(
        "what the record has of pictures leads elsewhere from %.3f s on: they are drawn again", time
    )


def _took_pictures(run: Run) -> bool:
    return any(sights.taken for sights in run.assembly.sights.values())


def _relived(
    record: Record,
    run: Run,
    steps: int,
    stop: StopRequest,
    pictures: Mapping[str, Mapping[float, KnownPicture]],
) -> Past:
    timestep = float(record.start["timestep"])
    for arm, known in pictures.items():
        if arm in run.assembly.sights:  # another tree may have other cameras
            run.assembly.sights[arm].known = known
    past = Past(record, run.world, steps)
    run.watch(past)
    while past.steps < steps and not past.differs and not run.done and not stop.asked:
        run.step(min(_AT_A_TIME_S, (steps - past.steps) * timestep))
    return past


def _explained(record: Record, remade: Remade, past: Past, registry: Registry) -> str:
    found = past.difference
    time = past.steps * float(record.start["timestep"])
    lines = [f"the past is not that of the record: it differs from {time:.3f} s on"]
    if found is not None and found.event:
        lines.append(found.event)
    elif found is not None and found.doing:
        lines.append(f"running then: {', '.join(found.doing)}")
    lines += edited(record, remade.trees, time)
    lines += differences(record, registry)
    return "\n  = ".join(lines)


def edited(record: Record, trees: Mapping[str, NodeSpec], time: float) -> Iterator[str]:
    """Sentences on nodes that are not what they were and had begun by a time in s."""
    timeline = Timeline(record)
    for arm, root in timeline.roots.items():
        if arm not in trees:
            yield f"the tree has no arm {arm!r} any more"
            continue
        facts = tree_facts(trees[arm])
        now = {node.path: node for node in node_of(arm, facts, str(facts["name"])).walk()}
        for node in root.walk():
            if node.changes and node.changes[0].time <= time:
                why = _edit(node, now.get(node.path))
                if why:
                    yield f"{arm}:{node.path} began at {node.changes[0].time:.2f} s and {why}"


def _edit(was: Node, now: Node | None) -> str:
    if now is None:
        return "is not in the tree any more"
    if now.kind != was.kind:
        return f"is a {now.kind} now, not a {was.kind}"
    if dict(now.ports) != dict(was.ports):
        names = sorted(
            name
            for name in now.ports.keys() | was.ports.keys()
            if now.ports.get(name) != was.ports.get(name)
        )
        return f"has another {', '.join(names)} now"
    return ""


def parse_place(text: str) -> tuple[Path, float]:
    """Folder and time of ``DIR@SECONDS``.

    Raises:
        ReplayError: It is not of that form.
    """
    folder, at, seconds = text.rpartition("@")
    try:
        time = float(seconds.strip().removesuffix("s"))
    except ValueError:
        time = -1.0
    if not at or not folder or not 0.0 < time < float("inf"):
        raise ReplayError(f"--resume takes DIR@SECONDS, for example out@12.4, not {text!r}")
    return Path(folder), time
