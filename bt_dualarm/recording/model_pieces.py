"""Compiled models of one run in few bytes: what two of them have in common is kept once.

An arm that is attached to a thing, or spawned, makes a new model whose meshes and textures are
those of the one before. These are cut out of MuJoCo's binary form and kept by their digest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.recording.block import Block

_LEAST: Final = 2048
"""Bytes from which on a part of a model is kept by its digest."""

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


class ModelReader:
    """Puts models together again, from the first block of a run on."""

    def __init__(self) -> None:
        self._parts: dict[str, Bytes] = {}

    def content(self, block: Block) -> bytes:
        """MuJoCo's binary form of the model in a block.

        Raises:
            ValueError: The block is damaged, or an earlier one is missing.
        """
        arrays: Mapping[str, npt.NDArray[np.generic]] = block.arrays
        try:
            rest = arrays["rest"].tobytes()
            self._parts |= {
                name: np.frombuffer(part.tobytes(), np.uint8)
                for name, part in arrays.items()
                if name != "rest"
            }
            return b"".join(self._joined(rest, block.data["cuts"]))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a model lacks a part: {error}") from error

    def _joined(self, rest: bytes, cuts: object) -> Iterator[bytes]:
        if not isinstance(cuts, list):
            raise TypeError("no list of cuts")
        at = taken = 0
        for start, end, digest in cuts:
            yield rest[taken : taken + start - at]
            taken += start - at
            yield self._parts[digest].tobytes()
            at = end
        yield rest[taken:]


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
