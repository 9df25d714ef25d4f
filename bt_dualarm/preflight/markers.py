"""Warnings of markers that are looked for and that nothing in the world bears."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from pydantic import ValidationError

from bt_dualarm.spec.annotations import models_in
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.problems import Problem


def unborne_markers(file: TreeFile, kinds: Mapping[str, Kind]) -> Iterator[Problem]:
    """Warn of every marker that a leaf looks for and no declared object bears.

    Args:
        file: Without errors.
        kinds: Kinds of all nodes, by name.
    """
    borne = {name: thing.marker for name, thing in file.objects.items() if thing.marker}
    for arm in file.arms.values():
        for node in arm.tree.walk():
            for port, wanted in _looked_for(node, kinds):
                if wanted not in borne.values():
                    message, hint = _instead(wanted, borne)
                    problem = node.port_problem((port,), f"{node.kind}: {port}: {message}", hint)
                    yield replace(problem, severity="warning")


def _looked_for(node: NodeSpec, kinds: Mapping[str, Kind]) -> Iterator[tuple[str, MarkerSpec]]:
    """Ports of a node that are a marker, as far as the file writes it out."""
    fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
    for port, declared in fields.items():
        if MarkerSpec in models_in(declared.annotation) and isinstance(node.ports.get(port), dict):
            try:
                yield port, MarkerSpec.model_validate(node.ports[port])
            except ValidationError:  # part of it is a key, known once it runs
                continue


def _instead(wanted: MarkerSpec, borne: Mapping[str, MarkerSpec]) -> tuple[str, str]:
    """Message and hint: what there is that is most like it."""
    which = f"marker {wanted.id} of {wanted.dictionary}"
    for name, marker in borne.items():
        if (marker.dictionary, marker.id) == (wanted.dictionary, wanted.id):
            sizes = f"{1e3 * marker.size:g} mm and not of {1e3 * wanted.size:g}"
            return f"that of {name} is of {sizes}", f"did you mean size: {marker.size:g}?"
    for name, marker in borne.items():
        if marker.id == wanted.id:
            message = f"nothing bears {which}; {name} bears {marker.id} of {marker.dictionary}"
            return message, f"did you mean dictionary: {marker.dictionary}?"
    known = ", ".join(f"{marker.id} of {marker.dictionary}" for marker in borne.values())
    return f"nothing bears {which}", f"there are {known}" if known else "no object has a marker"
