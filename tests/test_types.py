"""Law of types: every `Any` in a signature has its reason in a comment."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.source import MODULES, SKILLS, dotted_name, parsed


def types_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[ast.expr]:
    """Annotations of a function's arguments and result."""
    given = function.args
    arguments = [*given.posonlyargs, *given.args, given.vararg, *given.kwonlyargs, given.kwarg]
    declared = [argument.annotation for argument in arguments if argument is not None]
    yield from (annotation for annotation in [*declared, function.returns] if annotation)


def test_any_in_a_signature_has_a_comment() -> None:
    bare = [
        f"{dotted_name(path)}:{annotation.lineno}: {function.name}"
        for path in (*MODULES, *SKILLS)
        for lines in [path.read_text(encoding="utf-8").splitlines()]
        for function in ast.walk(parsed(path))
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for annotation in types_of(function)
        if any(isinstance(name, ast.Name) and name.id == "Any" for name in ast.walk(annotation))
        and "# " not in lines[annotation.lineno - 1]
    ]
    assert bare == []
