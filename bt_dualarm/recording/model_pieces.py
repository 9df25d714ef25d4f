"""Compiled models of one run in few bytes: what two of them have in common is kept once.

An arm that is attached to a thing, or spawned, makes a new model whose meshes and textures are
those of the one before. These are cut out of MuJoCo's binary form and kept by their digest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.recording.block import Block

_LEAST: Final = 2048
"""Bytes from which on a part of a model is kept by its digest."""

MOST_MODEL: Final = 1 << 25
"""Bytes of a model: sixteen arms with all of their meshes have a third of that."""

Bytes = npt.NDArray[np.uint8]


class ModelWriter:
    """Makes blocks of models; remembers which parts have been written."""

    def __init__(self) -> None:
        self._written: set[str] = set()

    def block(self, model: mujoco.MjModel, generation: int) -> Block:
        """A model as a block, without the parts that an earlier block has.

        Args:
            model: Compiled model.
            generation: Number of the world's recompilations until then.
        """
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        whole = content.tobytes()
        cuts = _cuts(model, whole)
        arrays: dict[str, Bytes] = {}
        rest, at = [], 0
        for start, end, digest in cuts:
            rest.append(whole[at:start])
            at = end
            if digest not in self._written:
                self._written.add(digest)
                arrays[digest] = content[start:end]
        rest.append(whole[at:])
        arrays["rest"] = np.frombuffer(b"".join(rest), np.uint8)
        return Block("model", {"generation": generation, "cuts": cuts}, arrays)


class ModelReader(Mapping[int, bytes]):
    """MuJoCo's binary form of each model of a run, by its generation, put together when asked for.

    Nothing is believed of a block: what its cuts say must fit the parts that are there.
    """

    def __init__(self) -> None:
        self._parts: dict[str, Bytes] = {}
        self._models: dict[int, tuple[bytes, list[tuple[int, int, str]]]] = {}

    def add(self, block: Block) -> None:
        """Take up the next block of a model, from the first of a run on.

        Raises:
            ValueError: The block does not fit together, or an earlier one is missing; the message
                says what is wrong, and what is expected.
        """
        if "rest" not in block.arrays:
            raise ValueError("model: array `rest` is missing")
        for name, part in block.arrays.items():
            if part.dtype != np.uint8 or part.ndim != 1:
                raise ValueError(
                    f"model: array {name[:80]!r} is of {part.dtype}, of {part.ndim} dimensions; "
                    "expected one of bytes"
                )
            if name != "rest":
                self._parts[name] = part.view(np.uint8)
        rest = block.arrays["rest"].tobytes()
        generation: Any = block.data["generation"]
        if generation in self._models:
            raise ValueError(f"model: generation {generation} is there already")
        self._models[generation] = rest, self._checked(block.data["cuts"], len(rest))

    def _checked(self, cuts: object, rest: int) -> list[tuple[int, int, str]]:
        """Cuts that follow each other, each of the length of its part, with nothing beyond."""
        found: list[tuple[int, int, str]] = []
        at = inside = 0
        for number, cut in enumerate(cuts if isinstance(cuts, list) else ()):
            where = f"model: cut {number}"
            if not (isinstance(cut, list) and [type(each) for each in cut] == [int, int, str]):
                raise ValueError(f"{where} is {str(cut)[:80]}; expected begin, end and a digest")
            start, end, digest = cut
            if digest not in self._parts:
                raise ValueError(f"{where}: there is no part {digest[:80]!r}")
            if not at <= start <= end or end - start != len(self._parts[digest]):
                raise ValueError(
                    f"{where} is from {start} to {end}, after {at}, for "
                    f"{len(self._parts[digest])} bytes: they do not fit"
                )
            inside += end - start
            at = end
            found.append((start, end, digest))
        if at - inside > rest or inside + rest > MOST_MODEL:
            raise ValueError(
                f"model: has {inside + rest} bytes, cuts up to {at}; expected at most {MOST_MODEL}"
            )
        return found

    def __getitem__(self, generation: int) -> bytes:
        """MuJoCo's binary form of a model."""
        rest, cuts = self._models[generation]
        pieces: list[bytes] = []
        at = taken = 0
        for start, end, digest in cuts:
            pieces += (rest[taken : taken + start - at], self._parts[digest].tobytes())
            taken += start - at
            at = end
        return b"".join((*pieces, rest[taken:]))

    def __iter__(self) -> Iterator[int]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)


def _cuts(model: mujoco.MjModel, whole: bytes) -> list[tuple[int, int, str]]:
    """Begin, end and digest of the large parts of a model that can be found in its binary form."""
    cuts = []
    for name in dir(model):
        if name.startswith("_"):
            continue
        value = getattr(model, name)
        if isinstance(value, np.ndarray) and value.nbytes >= _LEAST:
            part = np.ascontiguousarray(value).tobytes()
            at = whole.find(part)
            if at >= 0:
                cuts.append((at, at + len(part), hashlib.sha256(part).hexdigest()))
    apart, end = [], 0
    for cut in sorted(cuts):
        if cut[0] >= end:
            apart.append(cut)
            end = cut[1]
    return apart
