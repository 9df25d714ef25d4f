"""The manifest of a sweep: the tree, and the parameters, realities and seeds of its trials.

Trial ``i`` is a function of the manifest and ``i`` only, so trials can run in any order, on any
machine, and again. Seeds vary slowest: a sweep that is ended early has tried every combination of
parameters about equally often.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

from pydantic import ValidationError

from bt_dualarm.behaviors.load import load
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.runtime.file_check import check as check_tree
from bt_dualarm.runtime.file_check import checked_faults
from bt_dualarm.runtime.options import MOST_SEED, checked_reality, find_tree
from bt_dualarm.runtime.summary import processor
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import REALITY_NAMES
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.node_types import PortModel, number_in, port
from bt_dualarm.spec.parser import ParamSpec, UnitName, declared
from bt_dualarm.spec.problems import Problem, SpecError, errors, suggestion
from bt_dualarm.spec.yaml_reader import (
    Data,
    TreeInput,
    is_yaml,
    read_file,
    read_text,
    read_tree,
    with_tuples,
)
from bt_dualarm.sweeps.inputs import digest_of, inputs_of

MOST_TRIALS: Final = 10_000_000
"""Trials in one sweep; a larger number is more likely a mistake."""

TEXT: Final = "<text>"
"""Title of a sweep whose tree is YAML text or a mapping."""

SamplerName: TypeAlias = Literal["lhs", "sobol"]
"""How points are drawn: Latin hypercube sampling, or a scrambled Sobol sequence."""

_NUMERIC: Final = ("number", "integer", "duration", "angle")


class SweepError(DualArmError):
    """A sweep cannot be done as requested; the message names the argument and what is allowed."""


class NoTrials(SweepError):  # noqa: N818 - it reads as a sentence
    """No trial of a sweep has a row, so there is nothing to report."""


@dataclass(frozen=True)
class Grid:
    """Equidistant values of a parameter, both ends included.

    Attributes:
        low: First value.
        high: Last value.
        count: Number of values, at least 1; None for a range to draw samples from.
        unit: Unit that the ends were given in, converted to the one of parameters; empty if none.
    """

    low: float
    high: float
    count: int | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise SweepError(f"the range {self.low:g}:{self.high:g} does not rise")
        if self.count is not None and not 1 <= self.count <= MOST_TRIALS:
            raise SweepError(f"{self.count} is not a number of values from 1 to {MOST_TRIALS}")

    def values(self) -> tuple[float, ...]:
        """All values, rounded to 12 significant digits, so that they read as they were meant."""
        count = self.count or 1
        steps = range(count)
        share = [0.0] if count == 1 else [step / (count - 1) for step in steps]
        return tuple(float(f"{self.low + (self.high - self.low) * s:.12g}") for s in share)


Values: TypeAlias = Grid | tuple[Data, ...]
"""Values of one parameter: a grid or range of numbers, or a list."""


@dataclass(frozen=True)
class TrialSpec:
    """What defines one trial.

    Attributes:
        index: Number of the trial in its sweep, from 0.
        identity: Hash of everything that determines its result.
        params: Values of the tree's parameters by name.
        seed: Seed of all random numbers.
        reality: Name of the reality; None for the tree's.
    """

    index: int
    identity: str
    params: Mapping[str, Data]
    seed: int
    reality: str | None


@dataclass(frozen=True)
class Manifest:
    """Everything that defines the trials of a sweep.

    Attributes:
        tree: Path of the tree file, YAML text, or a mapping.
        seeds: Seeds, in order.
        params: Values of parameters, by name; parameters that are not listed have their defaults.
        realities: Names of realities; None stands for the tree's own.
        sampler: How to draw points from ranges of parameters; None for all combinations.
        samples: Number of points to draw.
        sampling_seed: Seed of the points.
        duration: Simulated seconds after which a trial ends; None for the tree's limit only.
        watchdog: Wall-clock budget of a tick of skill code, s; None for no limit.
        skills: Folders of skills in addition to the shipped ones.
        folder: Folder from which relative paths of a text or mapping start.
        search: Number of halvings of a search for the boundary of success in the parameters that
            are ranges; None for no search.
        faults: Faults to inject in every trial in addition to the tree's: the path of a file with
            a section ``faults``, or data of the same form; None for none.
        explicit: Combinations of parameters instead of ``params``, as a search chooses them.

    Raises:
        SweepError: The fields contradict each other.
    """

    tree: TreeInput
    seeds: tuple[int, ...] = (0,)
    params: Mapping[str, Values] = field(default_factory=dict)
    realities: tuple[str | None, ...] = (None,)
    sampler: SamplerName | None = None
    samples: int = 0
    sampling_seed: int = 0
    duration: float | None = None
    watchdog: float | None = None
    skills: tuple[Path, ...] = ()
    folder: Path | None = None
    search: int | None = None
    explicit: tuple[Mapping[str, Data], ...] = ()
    faults: TreeInput | None = None

    def __post_init__(self) -> None:
        ranges = [name for name, one in self.params.items() if _is_range(one)]
        for what in ("samples", "sampling_seed", "search"):
            number = getattr(self, what)
            whole = isinstance(number, int) and not isinstance(number, bool) and number >= 0
            if not whole and (number is not None or what != "search"):
                raise SweepError(f"{what}: {number!r} is not a whole number of at least 0")
        if self.sampler not in (None, *get_args(SamplerName)):
            raise SweepError(f"sample: {self.sampler!r} is not a sampler: lhs or sobol")
        if self.sampler is None:
            if self.samples:
                raise SweepError("a number of samples needs a sampler: lhs or sobol")
            if ranges and self.search is None:
                raise SweepError(
                    f"{ranges[0]}: a range without a number of values, FROM:TO, is for samples or "
                    "a search; FROM:TO:COUNT is a grid"
                )
        elif self.search is not None:
            raise SweepError("a search chooses its own points: leave out the samples")
        elif not ranges:
            raise SweepError("samples are drawn from ranges: give a parameter FROM:TO")
        elif self.samples < 1:
            raise SweepError("a sampler needs the number of samples, at least 1")
        for what, items in (("seed", self.seeds), ("reality", self.realities)):
            if not items:
                raise SweepError(f"a sweep needs at least one {what}")
            if len(set(items)) < len(items):
                twice = next(one for one in items if items.count(one) > 1)
                raise SweepError(f"{what} {twice} is given twice")
        for name, values in self.params.items():
            if not isinstance(values, Grid) and not values:
                raise SweepError(f"{name}: the list of values is empty")
        if len(self) > MOST_TRIALS:
            raise SweepError(f"{len(self)} trials are more than {MOST_TRIALS}")

    def __len__(self) -> int:
        if self.explicit:
            return len(self.explicit) * len(self.realities) * len(self.seeds)
        points = math.prod(
            [len(self._listed(one)) for one in self.params.values() if not _is_range(one)]
        )
        return points * max(self.samples, 1) * len(self.realities) * len(self.seeds)

    @cached_property
    def points(self) -> tuple[Mapping[str, Data], ...]:
        """Combinations of parameters, in the order of the manifest."""
        if self.explicit:
            return self.explicit
        listed = {n: self._listed(v) for n, v in self.params.items() if not _is_range(v)}
        combined = [dict(zip(listed, values, strict=True)) for values in product(*listed.values())]
        drawn = self._drawn()
        return tuple(
            {name: {**point, **sample}[name] for name in self.params}
            for sample in drawn
            for point in combined
        )

    def trial(self, index: int) -> TrialSpec:
        """The trial with this number.

        Raises:
            IndexError: There is none.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"trial {index} of {len(self)}")
        rest, reality = divmod(index, len(self.realities))
        number, point = divmod(rest, len(self.points))
        params = self.points[point]
        seed = self.seeds[number]
        name = self.realities[reality]
        content = f"[{self._fixed_text(params)}, {_compact([params, seed, name])}"
        identity = hashlib.sha256(content.encode()).hexdigest()[:24]
        return TrialSpec(index, identity, params, seed, name)

    def trials(self, shard: tuple[int, int] = (1, 1)) -> Iterator[TrialSpec]:
        """Yields the trials of a shard in their order.

        Args:
            shard: Number of the shard, from 1, and the number of shards. Trials are dealt out in
                turn.
        """
        number, count = shard
        return (self.trial(index) for index in range(number - 1, len(self), count))

    def as_dict(self) -> dict[str, object]:
        """The manifest as JSON-ready data, for people and for the report."""
        params = {
            name: {"from": v.low, "to": v.high} | ({"count": v.count} if v.count else {})
            if isinstance(v, Grid)
            else list(v)
            for name, v in self.params.items()
        }
        return {
            "tree": self.title,
            "seeds": list(self.seeds),
            "params": params,
            "reality": list(self.realities),
            "sample": self.sampler,
            "samples": self.samples,
            "sampling_seed": self.sampling_seed,
            "search": self.search,
            "duration": self.duration,
            "skills": [str(folder) for folder in self.skills],
            "trials": len(self),
            "depends_on": self.fixed_at(self.points[0] if self.points else {}),
        }

    @property
    def title(self) -> str:
        """Path of the tree, or a short name for a text or mapping."""
        return str(self.tree) if isinstance(self.tree, Path) else TEXT

    def inputs_at(self, point: Mapping[str, Data]) -> Mapping[str, str]:
        """Digests of code, tree and files of a trial, which its worker must find the same."""
        # Only a text can name a file or choose a gripper, so few points need a look at the tree.
        key = tuple(one for one in point.items() if isinstance(one[1], str))
        if key not in self._inputs:
            loaded = load(self.tree, self._registry.kinds, point, self.folder)
            source = read_tree(self.tree, self.folder) if loaded.file is None else None
            content = loaded.file.texts.values() if source is None else (source.text,)  # type: ignore[union-attr]
            self._inputs[key] = inputs_of(content, loaded.file, self.skills)
        return self._inputs[key]

    def fixed_at(self, point: Mapping[str, Data]) -> Mapping[str, object]:
        """What a trial depends on besides its parameters, seed and reality."""
        return {
            **self.inputs_at(point),
            "duration": self.duration,
            "processor": processor()["arithmetic"],
            **({} if self.faults is None else {"faults": self._faults_digest}),
        }

    def _fixed_text(self, point: Mapping[str, Data]) -> str:
        """`fixed_at` as text, made once for all points with the same inputs."""
        inputs = self.inputs_at(point)
        if id(inputs) not in self._texts:
            self._texts[id(inputs)] = _compact(self.fixed_at(point))
        return self._texts[id(inputs)]

    @cached_property
    def _inputs(self) -> dict[tuple[tuple[str, Data], ...], Mapping[str, str]]:
        """Digests by the texts among the parameters."""
        return {}

    @cached_property
    def _texts(self) -> dict[int, str]:
        """Texts by the identity of the digests in `_inputs`."""
        return {}

    @cached_property
    def _registry(self) -> Registry:
        return Registry.load(self.skills)

    @cached_property
    def _faults_digest(self) -> str:
        source = read_tree(self.faults or {}, self.folder)
        return digest_of(json.dumps(source.data, sort_keys=True, default=str).encode())

    def _listed(self, values: Values) -> tuple[Data, ...]:
        return values.values() if isinstance(values, Grid) else values

    def _drawn(self) -> list[dict[str, Data]]:
        """Points drawn from the ranges; one empty point without a sampler."""
        ranges = {name: v for name, v in self.params.items() if isinstance(v, Grid) and not v.count}
        if self.sampler is None or not ranges:
            return [{name: one.low for name, one in ranges.items()}]
        from scipy.stats import qmc

        rng = self.sampling_seed
        if self.sampler == "sobol":
            # The first points of a longer sequence are the same, so a sweep can be extended.
            engine = qmc.Sobol(len(ranges), scramble=True, rng=rng)
            unit = engine.random(2 ** max(0, math.ceil(math.log2(self.samples))))[: self.samples]
        else:
            unit = qmc.LatinHypercube(len(ranges), rng=rng).random(self.samples)
        return [
            {
                name: float(f"{one.low + (one.high - one.low) * share:.12g}")
                for (name, one), share in zip(ranges.items(), row, strict=True)
            }
            for row in unit
        ]


def _compact(data: object) -> str:
    return json.dumps(data, sort_keys=True)


def _is_range(values: Values) -> bool:
    return isinstance(values, Grid) and values.count is None


def checked(manifest: Manifest) -> Manifest:
    """A manifest whose tree, parameters and realities exist and are valid, before anything runs.

    Every value of each parameter is checked against its declaration, and the tree with the first
    point against its robots. Numbers become integers where the parameter is one.

    Raises:
        SpecError: The tree has errors, or a value of a parameter is invalid.
        SweepError: There is no such parameter or reality.
        NoSuchTree, RegistryError: There is no such tree; a skill is invalid.
    """
    tree = manifest.tree
    if isinstance(tree, str) and not is_yaml(tree):
        tree = find_tree(tree)
    manifest = replace(manifest, tree=tree)
    source = read_tree(tree, manifest.folder)
    problems: list[Problem] = []
    specs = declared(source, ("params",), problems)
    if errors(problems):
        raise SpecError(problems)
    params = {name: _typed(name, specs, values) for name, values in manifest.params.items()}
    manifest = replace(manifest, params=params)
    for name in manifest.realities:
        if name is not None:
            checked_reality(name)
    registry = Registry.load(manifest.skills)
    examined = check_tree(
        tree, registry.kinds, manifest.points[0], folder=manifest.folder, build=False
    )
    file = examined.runnable()
    if manifest.faults is not None:
        checked_faults(file, manifest.faults)
        # Workers on other machines may not have the file.
        manifest = replace(manifest, faults=read_tree(manifest.faults, manifest.folder).data)
    return manifest


def _typed(name: str, specs: Mapping[str, ParamSpec], values: Values) -> Values:
    """Values of a parameter in its type.

    Raises:
        SweepError: The tree does not declare the parameter, or a value is not valid.
    """
    if name not in specs:
        hint = suggestion(name, specs, "parameter") if specs else "the tree declares none"
        raise SweepError(f"the tree has no parameter '{name}'; {hint}")
    spec = specs[name]
    if isinstance(values, Grid):
        if spec.type not in _NUMERIC:
            raise SweepError(f"{name} is a {spec.type}: it has no range; list its values")
        if values.unit not in ("", spec.base_unit):
            raise SweepError(
                f"{name}: the range is in {values.unit}, the parameter "
                + (f"in {spec.base_unit}" if spec.base_unit else "has no unit")
            )
        values = replace(values, unit="")
        if values.count is None:
            ends: tuple[Data, ...] = (values.low, values.high)
            if spec.type == "integer":
                raise SweepError(f"{name} is an integer: list its values, or give FROM:TO:COUNT")
            _refuse(name, spec, ends)
            return values
        listed: tuple[Data, ...] = values.values()
    else:
        listed = tuple(spec.in_unit(_parsed(spec, value)) for value in values)
    if spec.type == "integer":
        listed = tuple(_whole(value) for value in listed)
    _refuse(name, spec, listed)
    texts = [json.dumps(value, sort_keys=True) for value in listed]
    if len(set(texts)) < len(texts):
        twice = next(text for text in texts if texts.count(text) > 1)
        raise SweepError(f"{name}: the value {twice} occurs twice")
    return listed


def _refuse(name: str, spec: ParamSpec, values: Sequence[Data]) -> None:
    for value in values:
        complaints = spec.complaints(name, value)
        if complaints:
            raise SweepError(f"parameter {complaints[0]}")


def _whole(value: Data) -> Data:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _parsed(spec: ParamSpec, value: Data) -> Data:
    """A value from the command line, read as YAML unless the parameter is a text."""
    if not isinstance(value, str) or spec.type in ("text", "object", "arm"):
        return value
    try:
        return read_text(value).data
    except SpecError:
        return value


# Notations of the command line.


_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_END: Final = rf"{_NUMBER}[^:,]*"
_GRID: Final = re.compile(rf"({_END}):({_END})(?::(\d+))?")


def seeds_of(text: str) -> tuple[int, ...]:
    """Seeds from text: ``0:1000`` excludes the end, ``0,4,9`` is a list, and both combine.

    Raises:
        SweepError: The text is neither.
    """
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,10})(?::(\d{1,10}))?\s*", part)
        if match is None:
            raise SweepError(f"{part!r} is neither a seed nor FIRST:END, for example 0:1000")
        first = int(match[1])
        end = first + 1 if match[2] is None else int(match[2])
        if not first < end <= MOST_SEED + 1 or end - first > MOST_TRIALS:
            raise SweepError(f"{part!r}: the end of seeds must be above their beginning")
        seeds += range(first, end)
    return tuple(seeds)


def values_of(text: str) -> Values:
    """Values of a parameter from text: ``0.2:1.0:5``, ``2cm:8cm``, ``a,b`` or ``[0,0,1],[1,0,0]``.

    Raises:
        SweepError: Brackets do not match, or a value is empty.
    """
    match = _GRID.fullmatch(text.strip())
    low = None if match is None else _quantity(match[1])
    high = None if match is None else _quantity(match[2])
    if match is not None and low is not None and high is not None:
        units = {unit for _, unit in (low, high) if unit}
        if len(units) > 1:
            raise SweepError(f"{text!r}: the ends of a range have units of different quantities")
        count = None if match[3] is None else int(match[3])
        return Grid(low[0], high[0], count, units.pop() if units else "")
    parts: list[str] = [""]
    depth = 0
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    if depth or not all(part.strip() for part in parts):
        raise SweepError(f"{text!r} is not a list of values: FROM:TO:COUNT, or values with commas")
    return tuple(part.strip() for part in parts)


def _quantity(text: str) -> tuple[float, str] | None:
    """A number with its unit as parameters have it, empty for none; None if it is neither."""
    if re.fullmatch(_NUMBER, text.strip()):
        return float(text), ""
    found = ((number_in(text.strip(), unit), unit) for unit in get_args(UnitName))
    return next(((number, unit) for number, unit in found if number is not None), None)


def shard_of(text: str) -> tuple[int, int]:
    """Number of a shard and the number of shards, from ``2/4``.

    Raises:
        SweepError: The text is not of this form.
    """
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", str(text))
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= number <= count:
        raise SweepError(f"shard: {text!r} is not a shard: 1/4 to 4/4 are the shards of four")
    return number, count


# Manifests as files.


class ManifestFile(PortModel):
    """Content of a manifest file; the version is in ``bt_sweep``."""

    bt_sweep: Literal[1] = port(..., "Version of the format: 1")
    tree: str = port(
        ..., "Path of the tree file from this file's folder, or name of a shipped tree"
    )
    seeds: str | tuple[int, ...] = port("0", "Seeds: FIRST:END, or a list")
    params: dict[str, Any] = port({}, "Values by name: FROM:TO:COUNT, a list, or one value")
    reality: tuple[str, ...] = port((), f"Realities: {', '.join(REALITY_NAMES)}")
    sample: SamplerName | None = port(None, "How to draw samples from ranges")
    samples: int = port(0, "Number of samples", ge=0)
    sampling_seed: int = port(0, "Seed of the samples", ge=0)
    search: int | None = port(None, "Halvings of a search for the boundary of success", ge=0, le=12)
    duration: float | None = port(None, "Longest simulated duration", unit="s", gt=0)
    skills: tuple[str, ...] = port((), "Folders of skills, from this file's folder")
    faults: str | None = port(None, "File with faults for every trial, from this file's folder")


def read_manifest(path: Path) -> Manifest:
    """Manifest of a YAML file; relative paths start from its folder.

    Raises:
        SpecError: The file has errors, located by line and column.
        SweepError: Its fields contradict each other.
    """
    source = read_file(path)
    try:
        content = ManifestFile.model_validate(with_tuples(source.data))
    except ValidationError as error:
        found = explain(error, ManifestFile, source.data, "field")
        raise SpecError(
            [source.problem(one.path, one.message, one.hint, key=one.at_key) for one in found]
        ) from error
    problems: list[Problem] = []

    @contextmanager
    def at(*place: str) -> Iterator[None]:
        try:
            yield
        except DualArmError as error:
            message, _, hint = str(error).partition("\n")
            problems.append(source.problem(place, message, hint.strip().removeprefix("= ")))

    tree = path.parent / content.tree
    with at("tree"):
        tree = tree if tree.is_file() else find_tree(content.tree)
    seeds: tuple[int, ...] = ()
    with at("seeds"):
        given = content.seeds
        seeds = seeds_of(given) if isinstance(given, str) else tuple(given)
    params: dict[str, Values] = {}
    for name, values in content.params.items():
        with at("params", name):
            listed = tuple(values) if isinstance(values, list | tuple) else (values,)
            params[name] = values_of(values) if isinstance(values, str) else listed
    for name in content.reality:
        with at("reality"):
            checked_reality(name)
    if problems:
        raise SpecError(problems)
    return Manifest(
        tree,
        seeds,
        params,
        tuple(content.reality) or (None,),
        content.sample,
        content.samples,
        content.sampling_seed,
        content.duration,
        skills=tuple(path.parent / folder for folder in content.skills),
        search=content.search,
        faults=None if content.faults is None else path.parent / content.faults,
    )


def is_manifest(path: Path) -> bool:
    """Whether a file is a manifest and not a tree."""
    try:
        data = read_file(path).data
    except SpecError:
        return False
    return isinstance(data, dict) and "bt_sweep" in data
