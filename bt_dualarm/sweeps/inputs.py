"""Digests of everything that determines a run besides its parameters, seed and reality.

They are part of a trial's identity, and a worker compares them with what it finds: a worker with
other code, or on another machine with other files, must not run the trial.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.robot import RobotFile, file_below, is_description_path
from bt_dualarm.robots.urdf_arm import mesh_finder, robot_data_dir
from bt_dualarm.runtime.summary import versions
from bt_dualarm.spec.document import TreeFile

_MESH: Final = re.compile(r"""\bfilename\s*=\s*["']([^"']+)["']""")


def digest_of(content: bytes) -> str:
    """Digest that tells contents apart."""
    return hashlib.sha256(content).hexdigest()[:16]


@cache
def code_digest() -> str:
    """Digest of the package's code, the shipped skills and the shipped descriptions.

    Within one version number the code of a checkout changes; a trial of other code is another one.
    """
    package = Path(__file__).parents[1]
    folders = (package, *(share_dir(kind) for kind in ("skills", "assets")))
    return digest_of("".join(map(_digest_of_folder, folders)).encode())


def inputs_of(
    texts: Iterable[str], file: TreeFile | None, skills: tuple[Path, ...]
) -> Mapping[str, str]:
    """Digests by what they are of.

    Args:
        texts: Texts of the tree and of the files that it includes.
        file: The tree, None if it cannot be loaded.
        skills: Folders of additional skills.
    """
    files = () if file is None else sorted(set(_files_of(file)))
    found = {
        "tree": digest_of("\n".join(texts).encode()),
        "code": code_digest(),
        "skills": ",".join(map(_digest_of_folder, skills)),
        "files": ",".join(digest_of(path.read_bytes()) for path in files),
        **{f"version of {name}": number for name, number in versions().items()},
    }
    return {name: value for name, value in found.items() if value}


@cache
def inputs_of_module(name: str) -> Mapping[str, str]:
    """Digests of what determines the results of a module's functions besides their arguments.

    Its own text, those of the modules of its package that it imports, the package with its shipped
    trees, and the versions of all libraries.
    """
    texts = sorted(_texts_of_modules(name).items())
    return {
        "module": digest_of("".join(f"{module}\0{text}\0" for module, text in texts).encode()),
        "code": code_digest(),
        "trees": _digest_of_folder(share_dir("trees")),
        **{f"version of {package}": number for package, number in versions().items()},
    }


def _texts_of_modules(first: str) -> Mapping[str, str]:
    """Texts of a module and of all modules of its package that it imports, by name."""
    package = first.partition(".")[0]
    texts: dict[str, str] = {}
    left = [first]
    while left:
        name = left.pop()
        spec = None
        with suppress(ImportError):  # a name in a module is no module
            spec = find_spec(name)
        if name in texts or spec is None or not spec.has_location or spec.origin is None:
            continue
        texts[name] = Path(spec.origin).read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(texts[name])):
            if isinstance(node, ast.Import):
                found = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            else:
                continue
            left += [one for one in found if one.partition(".")[0] == package]
    return texts


def _digest_of_folder(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".yaml", ".yml"))
    parts = (path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes()
             for path in files)  # fmt: skip
    return digest_of(b"\0".join(parts))


def _files_of(file: TreeFile) -> Iterator[Path]:
    """Files of descriptions and meshes next to a tree; shipped ones are part of the code."""
    root = file.root.resolve()
    for arm in file.arms.values():
        path = file_below(root, arm.robot) if is_description_path(arm.robot) else None
        if path is not None:
            yield from _files_of_robot(path)
        if isinstance(arm.gripper, str) and is_description_path(arm.gripper):
            gripper = file_below(root, arm.gripper)
            yield from () if gripper is None else (gripper,)
    for obj in file.objects.values():
        # That of a fixture is next to its scene.
        if obj.file is not None and obj.mesh_path.is_file():
            yield obj.mesh_path.resolve()


def _files_of_robot(path: Path) -> Iterator[Path]:
    """A robot's description, and its URDF, SRDF and meshes unless they are of a package."""
    yield path
    folder = path.parent
    try:
        entry = RobotFile(path).entry
    except DualArmError:
        return  # the check of the tree reports it
    for name in filter(None, (entry.urdf, entry.srdf)):
        part = file_below(folder, name)
        if part is None:
            continue
        yield part
        find = mesh_finder(part, folder, robot_data_dir().parent)
        for mesh in _MESH.findall(part.read_text(encoding="utf-8", errors="replace")):
            with suppress(ValueError):
                found = find(mesh)
                if found.resolve().is_relative_to(folder):
                    yield found.resolve()
