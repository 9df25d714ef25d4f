"""Expressions in the values of ports: ``"{n} + 1"``, ``"2 * {radius}"``, ``"{pose}.z > 5 cm"``.

A text that contains a reference to a key or a parameter, and more than that, is an expression. Its
tokens are checked against a whitelist, then Python's own parser builds the syntax tree, of which a
whitelist of node types is evaluated here; nothing is compiled or executed. `type_of` finds units
that do not fit before any value is known.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Final, cast

import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.spec.dimensions import (
    ANGLE,
    ANYTHING,
    BARE,
    LENGTH,
    TEXT,
    TRUTH,
    UNITS,
    Dimension,
    ValueType,
    misfit,
)
from bt_dualarm.spec.node_types import (
    KEY,
    QUANTITY,
    REFERENCE,
    as_text,
    counted,
    in_words,
    is_expression,
    key_name,
    reference_of,
    scaled,
    shown,
)
from bt_dualarm.spec.problems import nearest, suggestion
from bt_dualarm.spec.yaml_reader import LARGEST_INTEGER, Data

# Parsing.

MAX_LENGTH: Final = 500
_DEEPEST: Final = 30
_LONGEST_TEXT: Final = 1000
_LONGEST_NUMBER: Final = 40

_WORDS: Final = ("and", "or", "not", "if", "else")
_CONSTANTS: Final[Mapping[str, Data]] = {"true": True, "false": False, "pi": math.pi}
_UNIT: Final = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
_TOKEN: Final = re.compile(
    rf"""(?P<quoted>'[^'"\\{{}}]*'|"[^'"\\{{}}]*")
    |(?P<reference>\{{[^{{}}]*\}})
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)(?:\s*(?P<unit>{_UNIT})(?![\w/²]))?
    |(?P<word>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<space>\s+)
    |(?P<sign><=|>=|==|!=|//|\*\*|[-+*/%<>()\[\],.])""",
    re.VERBOSE,
)
_INSTEAD: Final = {
    "=": "write == to compare",
    "&": "write 'and'",
    "|": "write 'or'",
    "!": "write 'not', or != to compare",
    "^": "there are no powers: multiply, or use sqrt()",
    "**": "there are no powers: multiply, or use sqrt()",
    "$": "a key or a parameter is written without $: {key}",
    "{": "a key or a parameter has single braces: {key}",
    "}": "a key or a parameter has single braces: {key}",
    "'": "a quoted text ends with the quote that it began with, and has no \\, quotes, { or }",
    '"': "a quoted text ends with the quote that it began with, and has no \\, quotes, { or }",
}
_GRAMMAR: Final = (
    "an expression has {keys}, numbers with or without a unit, 'texts', [lists], + - * / // %, "
    "comparisons, and, or, not, if else, functions and parts such as {pose}.x: "
    "see docs/expressions.md"
)


class ExpressionError(ValueError):
    """An expression is malformed, or has no value.

    Attributes:
        start: First character that is wrong.
        end: Character after the last one that is wrong.
        hint: What is allowed; may be empty.
    """

    def __init__(self, message: str, start: int, end: int, hint: str = "") -> None:
        super().__init__(message)
        self.start = start
        self.end = end
        self.hint = hint


@dataclass(frozen=True, eq=False)
class Expression:
    """A parsed expression.

    Attributes:
        text: Its text.
        keys: Keys and parameters to which it refers, each once, in their order.
        tree: Syntax tree, in which a placeholder name stands for each operand.
        operands: Key (as ``{key}``) or value of each placeholder, with its type.
        origin: Index in ``text`` of each character from which ``tree`` was parsed.
    """

    text: str
    keys: tuple[str, ...]
    tree: ast.expr
    operands: Mapping[str, tuple[Data, ValueType]]
    origin: tuple[int, ...]

    def error(self, node: ast.AST, message: str, hint: str = "") -> ExpressionError:
        """Returns an error of a part of the expression."""
        start = self.origin[getattr(node, "col_offset", 0)]
        end = self.origin[(getattr(node, "end_col_offset", 0) or 1) - 1] + 1
        return ExpressionError(message, start, max(start + 1, end), hint)

    def part(self, node: ast.AST) -> str:
        """Returns a part of the expression as its author wrote it."""
        error = self.error(node, "")
        return shown(self.text[error.start : error.end].strip())


def _last(text: str) -> str:
    return next((letter for letter in reversed(text) if not letter.isspace()), "")


@lru_cache(maxsize=4096)
def parse(text: str) -> Expression:
    """Returns the parsed expression.

    Raises:
        ExpressionError: It is malformed.
    """
    if len(text) > MAX_LENGTH:
        message = f"an expression has at most {MAX_LENGTH} characters, not {len(text)}"
        raise ExpressionError(message, 0, len(text), "write parts of it to keys with 'set'")
    source = ""
    origin: list[int] = []
    operands: dict[str, tuple[Data, ValueType]] = {}
    keys: dict[str, None] = {}
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            message = f"'{text[position]}' is not allowed in an expression"
            hint = _INSTEAD.get(text[position], _GRAMMAR)
            raise ExpressionError(message, position, position + 1, hint)
        token = match[0]
        start = position
        position = match.end()
        operand = _operand(match, start, is_part=_last(source) == ".")
        if operand is not None:
            if match["reference"]:
                keys[match["reference"][1:-1]] = None
            name = f"_{len(operands)}"
            operands[name] = operand
            source += f" {name} "
            origin += [start, start, *[position - 1] * len(name)]
        elif match["space"]:
            source += " "
            origin.append(start)
        else:
            source += token
            origin += range(start, position)
    stripped = source.lstrip()
    origin = [*origin[len(source) - len(stripped) :], max(0, len(text) - 1)]
    try:
        tree = ast.parse(stripped, mode="eval").body
    except SyntaxError as error:
        column = (error.offset or 0) - 1  # at the end of the text it has none
        at = origin[column if 0 <= column < len(origin) else -1]
        # By what is missing, because each version of Python has other words for other errors.
        is_part = "was never closed" in error.msg or error.msg.startswith("expected 'else'")
        message = (
            "this expression is not complete"
            if is_part
            else f"'{shown(text)}' is not an expression"
        )
        raise ExpressionError(message, at, at + 1, _GRAMMAR) from error
    except (RecursionError, MemoryError, ValueError) as error:
        raise ExpressionError(
            "this expression is nested too deep", 0, len(text), "write parts of it to keys"
        ) from error
    expression = Expression(text, tuple(keys), tree, MappingProxyType(operands), tuple(origin))
    _refuse_others(expression)
    return expression


def _operand(match: re.Match[str], start: int, *, is_part: bool) -> tuple[Data, ValueType] | None:
    """Returns the value of a token that is an operand with its type, None for any other token."""
    end = match.end()
    if match["reference"]:
        key = match["reference"][1:-1]
        if not KEY.fullmatch(key_name(key)):
            message = f"'{match[0]}' is not a reference to a key"
            hint = "a key has letters, digits and _ and begins with a letter"
            raise ExpressionError(message, start, end, hint)
        return match[0], ANYTHING
    if match["quoted"]:
        return match[0][1:-1], TEXT
    if match["number"]:
        return _number(match, start)
    word = match["word"]
    if word is None or is_part or word in _WORDS or word in FUNCTIONS:
        return None
    if word in _CONSTANTS:
        return _CONSTANTS[word], TRUTH if word != "pi" else ValueType("number", ())
    if word in UNITS:
        hint = f"a unit follows a number: 1 {word}"
        raise ExpressionError(f"there is no name '{word}'", start, end, hint)
    if word == "is":
        raise ExpressionError("'is' is not allowed in an expression", start, end, _INSTEAD["="])
    close = nearest(word, {*_WORDS, *_CONSTANTS, *FUNCTIONS})
    hint = f"did you mean '{close}'? " if close else ""
    hint += f"a key or a parameter needs braces: {{{word}}}; a text needs quotes"
    raise ExpressionError(f"there is no name '{word}'", start, end, hint)


def _number(match: re.Match[str], start: int) -> tuple[Data, ValueType]:
    digits = match["number"]
    after = match.string[match.end() : match.end() + 1]
    if after.isalpha() or after in ("_", "°", "²"):
        message = f"'{digits}{after}' is neither a number nor a quantity"
        units = ", ".join(UNITS)
        raise ExpressionError(message, start, match.end() + 1, f"units are {units}")
    whole = digits.isdigit()
    if len(digits) > _LONGEST_NUMBER or abs(float(digits)) > LARGEST_INTEGER:
        raise ExpressionError("this number is too large", start, match.end())
    value = int(digits) if whole else float(digits)
    if match["unit"] is None:
        return value, BARE
    factor, dimension = UNITS[match["unit"]]
    return scaled(value, factor), ValueType("number", dimension)


_ALLOWED: Final = (
    ast.Name, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.List, ast.Subscript,
    ast.Attribute, ast.Call, ast.IfExp,
)  # fmt: skip


def _refuse_others(expression: Expression) -> None:
    waiting: list[tuple[ast.AST, int]] = [(expression.tree, 0)]
    while waiting:
        node, depth = waiting.pop()
        if depth > _DEEPEST:
            message = "this expression is nested too deep"
            raise expression.error(node, message, "write parts of it to keys with 'set'")
        if not isinstance(node, _ALLOWED) or isinstance(getattr(node, "op", None), ast.Pow):
            power = isinstance(getattr(node, "op", None), ast.Pow)
            message = f"'{expression.part(node)}' is not allowed in an expression"
            raise expression.error(node, message, _INSTEAD["**"] if power else _GRAMMAR)
        below: list[ast.AST] = []
        if isinstance(node, ast.Name):
            if node.id in FUNCTIONS:
                raise expression.error(node, f"'{node.id}' is a function: write {node.id}(…)")
        elif isinstance(node, ast.Call):
            if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS:
                message = f"'{expression.part(node.func)}' is not a function"
                raise expression.error(node, message, f"functions: {', '.join(FUNCTIONS)}")
            function = FUNCTIONS[node.func.id]
            if not function.least <= len(node.args) <= function.most:
                message = f"{node.func.id} takes {function.count}, not {len(node.args)}"
                raise expression.error(node, message)
            below = [*node.args]
        else:
            below = [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
        waiting += [(child, depth + 1) for child in below]


# Types, which are known before any value is.


def type_of(expression: Expression, types: Mapping[str, ValueType]) -> ValueType:
    """Returns the type of an expression's value.

    Args:
        expression: The expression.
        types: Types of its keys and parameters, as far as they are known.

    Raises:
        ExpressionError: Units or types do not fit together, such as a length plus an angle.
    """
    return _Typing(expression, types).of(expression.tree)


@dataclass(frozen=True)
class _Typing:
    expression: Expression
    types: Mapping[str, ValueType]

    def of(self, node: ast.expr) -> ValueType:
        """Returns the type of a part of the expression."""
        if isinstance(node, ast.Name):
            value, known = self.expression.operands[node.id]
            key = reference_of(value) if known is ANYTHING else None
            return known if key is None else self.types.get(key, ANYTHING)
        if isinstance(node, ast.BinOp):
            return self._arithmetic(node)
        if isinstance(node, ast.UnaryOp):
            value = self.of(node.operand)
            if isinstance(node.op, ast.Not):
                self._expect(node.operand, value, "boolean")
                return TRUTH
            self._expect(node.operand, value, "number", "array", "string")
            return value
        if isinstance(node, ast.BoolOp):
            for each in node.values:
                self._expect(each, self.of(each), "boolean")
            return TRUTH
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            found = [self.of(side) for side in sides]
            for a, b in pairwise(found):
                self._same_unit(node, a, b, "compares")
            return TRUTH
        if isinstance(node, ast.List):
            return self._list(node)
        if isinstance(node, ast.IfExp):
            self._expect(node.test, self.of(node.test), "boolean")
            return self._same_unit(node, self.of(node.body), self.of(node.orelse), "chooses from")
        if isinstance(node, ast.Subscript):
            whole = self.of(node.value)
            self._expect(node.value, whole, "array")
            self._expect(node.slice, self.of(node.slice), "number")
            if whole.dimension is None and not whole.bare:
                return ANYTHING  # perhaps a list of poses
            return ValueType("number", whole.dimension, whole.bare)
        if isinstance(node, ast.Attribute):
            return self._part(node)
        call = cast("ast.Call", node)
        return self._call(call, cast("ast.Name", call.func).id)

    def _expect(self, node: ast.expr, found: ValueType, *kinds: str) -> None:
        if found.kind and found.kind not in kinds:
            names = {"number": "a number", "boolean": "true or false", "array": "a list",
                     "string": "a text", "object": "a mapping"}  # fmt: skip
            wanted = names[kinds[0]]
            message = f"'{self.expression.part(node)}' is {names[found.kind]}, not {wanted}"
            raise self.expression.error(node, message)

    def _same_unit(self, node: ast.expr, a: ValueType, b: ValueType, verb: str) -> ValueType:
        """Returns the type of a sum; raises if its sides have different units."""
        if a.dimension is not None and b.dimension is not None and a.dimension != b.dimension:
            message = f"'{self.expression.part(node)}' {verb} {a.noun} and {b.noun}"
            raise self.expression.error(node, message, "both must have the same unit")
        kind = a.kind if a.kind == b.kind else ""
        known = a if a.dimension is not None else b
        return ValueType(kind, known.dimension, a.bare and b.bare)

    def _arithmetic(self, node: ast.BinOp) -> ValueType:
        a = self.of(node.left)
        b = self.of(node.right)
        product = isinstance(node.op, ast.Mult | ast.Div | ast.FloorDiv)
        for side, found in ((node.left, a), (node.right, b)):
            kinds = ("number", "array", "string") if product else (
                "number", "array", "string", "object"
            )  # fmt: skip
            self._expect(side, found, *kinds)
        if not product:
            verb = {ast.Add: "adds", ast.Sub: "subtracts"}.get(type(node.op), "divides")
            if "object" in (a.kind, b.kind):  # a pose plus a vector
                vector = b if a.kind == "object" else a
                self._same_unit(node, ValueType("", LENGTH), vector, verb)
                return ValueType("object")
            return self._same_unit(node, a, b, verb)
        kind = "array" if "array" in (a.kind, b.kind) else "number" if a.kind and b.kind else ""
        if a.bare and b.bare:
            return ValueType(kind, None, True)
        left = () if a.bare else a.dimension
        right = () if b.bare else b.dimension
        if left is None or right is None:
            return ValueType(kind)
        sign = 1 if isinstance(node.op, ast.Mult) else -1
        return ValueType(kind, _product(left, right, sign))

    def _list(self, node: ast.List) -> ValueType:
        found = [self.of(item) for item in node.elts]
        numbers = [item for item in found if item.kind in ("number", "")]
        units = {item.dimension for item in numbers if item.dimension is not None}
        if len(numbers) == len(found) and len(units) == 1:
            return ValueType("array", next(iter(units)))
        return ValueType("array", None, bool(found) and all(item.bare for item in found))

    def _part(self, node: ast.Attribute) -> ValueType:
        whole = self.of(node.value)
        if whole.kind not in ("array", "object", ""):
            message = f"'{self.expression.part(node.value)}' has no parts"
            raise self.expression.error(node, message, "lists and mappings have")
        if node.attr in _AXES:
            return ValueType("number", whole.dimension if whole.kind == "array" else LENGTH)
        if node.attr in _TURNS:
            return ValueType("number", ANGLE)
        units = {"xyz": LENGTH, "look_at": LENGTH, "rpy": ANGLE, "quat": ()}
        known = node.attr in units
        return ValueType("array", units[node.attr]) if known else ANYTHING

    def _call(self, node: ast.Call, name: str) -> ValueType:
        found = [self.of(argument) for argument in node.args]
        if name in ("sin", "cos", "tan"):
            complaint = misfit(found[0], ANGLE)
            if complaint:
                raise self.expression.error(node.args[0], f"{name}: {complaint}")
            return ValueType("number", ())
        if name in ("min", "max"):
            result = found[0]
            for one in found[1:]:
                result = self._same_unit(node, result, one, "compares")
            return result if len(found) > 1 else ValueType("number", result.dimension, result.bare)
        if name == "atan2":
            self._same_unit(node, found[0], found[1], "compares")
            return ValueType("number", ANGLE)
        if name == "sqrt":
            known = found[0].dimension
            half = None if known is None else tuple((base, power / 2) for base, power in known)
            return ValueType("number", half, found[0].bare)
        if name in ("abs", "norm", "round", "floor", "ceil"):
            return ValueType("number", found[0].dimension, found[0].bare)
        return {"len": ValueType("number", ()), "text": TEXT}.get(name, ANYTHING)


def _product(left: Dimension, right: Dimension, sign: int) -> Dimension:
    powers = dict(left)
    for base, exponent in right:
        powers[base] = powers.get(base, 0) + sign * exponent
    return tuple(sorted((base, power) for base, power in powers.items() if power))


# Values.

_AXES: Final = ("x", "y", "z")
_TURNS: Final = ("roll", "pitch", "yaw")


def value_of(expression: Expression, read: Callable[[str], Data]) -> Data:
    """Returns the value of an expression in YAML notation.

    Args:
        expression: The expression.
        read: Function from a key or parameter to its value; may raise.

    Raises:
        ExpressionError: It has no value: a division by zero, a text times a number, …
    """
    return _Evaluation(expression, read).of(expression.tree)


@dataclass(frozen=True)
class _Evaluation:
    expression: Expression
    read: Callable[[str], Data]

    def of(self, node: ast.expr) -> Data:
        """Returns the value of a part of the expression."""
        if isinstance(node, ast.Name):
            value, known = self.expression.operands[node.id]
            key = reference_of(value) if known is ANYTHING else None
            return value if key is None else self.read(key)
        if isinstance(node, ast.BoolOp):
            decides = isinstance(node.op, ast.Or)
            for each in node.values:
                if self._truth(each) is decides:
                    return decides
            return not decides
        if isinstance(node, ast.IfExp):
            return self.of(node.body if self._truth(node.test) else node.orelse)
        if isinstance(node, ast.UnaryOp):
            if isinstance(node.op, ast.Not):
                return not self._truth(node.operand)
            value = self.of(node.operand)
            return self._times(node, -1, value) if isinstance(node.op, ast.USub) else value
        if isinstance(node, ast.Compare):
            return self._compared(node)
        if isinstance(node, ast.BinOp):
            return self._arithmetic(node)
        if isinstance(node, ast.List):
            return [self.of(item) for item in node.elts]
        if isinstance(node, ast.Subscript):
            return self._item(node)
        if isinstance(node, ast.Attribute):
            return self._part(node)
        call = cast("ast.Call", node)
        name = cast("ast.Name", call.func).id
        values = [self.of(argument) for argument in call.args]
        function = FUNCTIONS[name]
        if function.of_numbers:
            values = [self._number(a, v) for a, v in zip(call.args, values, strict=True)]
        try:
            return self._checked(node, function.value(*values))
        except (ValueError, TypeError, OverflowError) as error:
            given = ", ".join(map(in_words, values))
            raise self.expression.error(node, f"{name} has no value for {given}") from error

    def _truth(self, node: ast.expr) -> bool:
        value = self.of(node)
        if not isinstance(value, bool):
            message = f"'{self.expression.part(node)}' is {in_words(value)}, not true or false"
            raise self.expression.error(node, message)
        return value

    def _number(self, node: ast.expr, value: Data) -> float:
        number = as_number(value)
        if number is None:
            message = f"'{self.expression.part(node)}' is {in_words(value)}, not a number"
            raise self.expression.error(node, message)
        return number

    def _checked(self, node: ast.expr, value: Data) -> Data:
        """Returns a result unless it is too large."""
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if is_number and not (math.isfinite(value) and abs(value) <= LARGEST_INTEGER):
            message = f"'{self.expression.part(node)}' is too large"
            raise self.expression.error(node, message, f"at most {LARGEST_INTEGER} is allowed")
        if isinstance(value, str) and len(value) > _LONGEST_TEXT:
            message = f"'{self.expression.part(node)}' has more than {_LONGEST_TEXT} characters"
            raise self.expression.error(node, message)
        return value

    def _compared(self, node: ast.Compare) -> bool:
        left = self.of(node.left)
        side: ast.expr = node.left
        for relation, other in zip(node.ops, node.comparators, strict=True):
            right = self.of(other)
            if isinstance(relation, ast.Eq | ast.NotEq):
                holds = _equal(left, right) == isinstance(relation, ast.Eq)
            else:
                holds = _ORDER[type(relation)](self._number(side, left), self._number(other, right))
            if not holds:
                return False
            left = right
            side = other
        return True

    def _arithmetic(self, node: ast.BinOp) -> Data:
        a = self.of(node.left)
        b = self.of(node.right)
        if isinstance(node.op, ast.Mult):
            return self._times(node, a, b)
        if isinstance(node.op, ast.Div) and isinstance(a, list):
            divisor = self._number(node.right, b)
            if divisor == 0:
                raise self.expression.error(node, self._by_zero(node))
            return self._times(node, 1.0 / divisor, a)
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = 1 if isinstance(node.op, ast.Add) else -1
            if sign == 1 and isinstance(a, str) and isinstance(b, str) and as_number(a) is None:
                return self._checked(node, a + b)
            return self._sum(node, a, b, sign)
        x = self._number(node.left, a)
        y = self._number(node.right, b)
        if y == 0:
            raise self.expression.error(node, self._by_zero(node))
        if isinstance(node.op, ast.Div):
            exact = isinstance(x, int) and isinstance(y, int) and x % y == 0
            return x // y if exact else self._checked(node, x / y)
        return self._checked(node, x // y if isinstance(node.op, ast.FloorDiv) else x % y)

    def _by_zero(self, node: ast.BinOp) -> str:
        return f"'{self.expression.part(node)}' divides by zero"

    def _sum(self, node: ast.BinOp, a: Data, b: Data, sign: int) -> Data:
        if isinstance(a, list) and isinstance(b, list):
            if len(a) != len(b):
                message = f"'{self.expression.part(node)}': lists of {len(a)} and {len(b)}"
                raise self.expression.error(node, message, "only lists of one length are added")
            return [self._sum(node, x, y, sign) for x, y in zip(a, b, strict=True)]
        if isinstance(a, dict) and isinstance(a.get("xyz"), list) and isinstance(b, list):
            if a.get("look_at") is not None:
                message = f"'{self.expression.part(node)}': a pose that looks at a point is fixed"
                raise self.expression.error(node, message, "use its parts, such as .xyz")
            return {**a, "xyz": self._sum(node, a["xyz"], b, sign)}
        x = as_number(a)
        y = as_number(b)
        if x is None or y is None:
            verb = "added" if sign == 1 else "subtracted"
            message = f"'{self.expression.part(node)}': {in_words(a)} and {in_words(b)}"
            raise self.expression.error(node, f"{message} cannot be {verb}")
        return self._checked(node, x + sign * y)

    def _times(self, node: ast.expr, a: Data, b: Data) -> Data:
        if isinstance(a, list) and as_number(b) is not None:
            return [self._times(node, item, b) for item in a]
        if isinstance(b, list) and as_number(a) is not None:
            return [self._times(node, a, item) for item in b]
        x = as_number(a)
        y = as_number(b)
        if x is None or y is None:
            message = f"'{self.expression.part(node)}': {in_words(a if x is None else b)} is no "
            raise self.expression.error(node, f"{message}number")
        return self._checked(node, x * y)

    def _item(self, node: ast.Subscript) -> Data:
        whole = self.of(node.value)
        index = self.of(node.slice)
        name = self.expression.part(node.value)
        if not isinstance(whole, list):
            raise self.expression.error(node, f"'{name}' is {in_words(whole)}, not a list")
        if not isinstance(index, int) or isinstance(index, bool):
            message = f"an index is a whole number, not {in_words(index)}"
            raise self.expression.error(node.slice, message)
        if not -len(whole) <= index < len(whole):
            message = f"'{name}' has no item {index}: it has {len(whole)}, counted from 0"
            raise self.expression.error(node, message)
        return whole[index]

    def _part(self, node: ast.Attribute) -> Data:
        whole = self.of(node.value)
        name = node.attr
        if isinstance(whole, list) and len(whole) == 3 and name in _AXES:
            return whole[_AXES.index(name)]
        if isinstance(whole, dict) and isinstance(whole.get("xyz"), list):
            if name in _AXES:
                return whole["xyz"][_AXES.index(name)]
            if name in (*_TURNS, "rpy") and whole.get("rpy") is None:
                quaternion = np.array(whole.get("quat") or (1.0, 0.0, 0.0, 0.0), float)
                pose = Pose(np.zeros(3), quaternion / np.linalg.norm(quaternion))
                turns = [math.degrees(turn) for turn in pose.rpy]
                return turns if name == "rpy" else turns[_TURNS.index(name)]
            if name in _TURNS:
                return whole["rpy"][_TURNS.index(name)]
        if isinstance(whole, dict) and whole.get(name) is not None:
            return whole[name]
        message = f"'{self.expression.part(node.value)}', {in_words(whole)}, has no part '{name}'"
        parts = [each for each, item in whole.items() if item is not None] if isinstance(
            whole, dict
        ) else [*_AXES] if isinstance(whole, list) and len(whole) == 3 else []  # fmt: skip
        raise self.expression.error(node, message, suggestion(name, parts, "part") if parts else "")


_ORDER: Final[Mapping[type[ast.cmpop], Callable[[float, float], bool]]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
}


def as_number(value: Data) -> float | None:
    """Returns the number that a value is, in the unit of a bare number; None if it is none.

    A text with a unit, ``"500 ms"``, is a number, too.
    """
    if isinstance(value, bool):
        return None
    if isinstance(value, (int, float)):
        return value
    match = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if match is None or match[2] not in UNITS:
        return None
    return float(match[1]) * UNITS[match[2]][0]


def _equal(a: Data, b: Data) -> bool:
    """Returns whether two values are the same, a number with a unit and a bare one included."""
    x = as_number(a)
    y = as_number(b)
    return x == y if x is not None and y is not None else same(a, b)


def same(a: Data, b: Data) -> bool:
    """Returns whether YAML data are equal; unlike in Python, true is not 1."""
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b)


@dataclass(frozen=True)
class Function:
    """A function of expressions.

    Attributes:
        value: Function of its arguments.
        least: Smallest number of arguments.
        most: Largest number of arguments.
        of_numbers: Whether all arguments are numbers.
        description: One line for the documentation.
    """

    value: Callable[..., Data]
    least: int
    most: int
    description: str
    of_numbers: bool = True

    @property
    def count(self) -> str:
        """Number of its arguments as text."""
        if self.least == self.most:
            return counted(self.least, "value")
        return f"{self.least} to {self.most} values"


def _rounded(number: float, digits: float = 0) -> float:
    return round(number, int(digits)) if digits else round(number)


def _norm(vector: Data) -> float:
    return math.hypot(*(float(as_number(item)) for item in vector))  # type: ignore[arg-type]


def _length(values: Data) -> int:
    if not isinstance(values, (list, str)):
        raise TypeError
    return len(values)


_MANY: Final = 20

FUNCTIONS: Final[Mapping[str, Function]] = {
    "abs": Function(abs, 1, 1, "magnitude of a number"),
    "min": Function(min, 2, _MANY, "smallest of several numbers"),
    "max": Function(max, 2, _MANY, "largest of several numbers"),
    "round": Function(_rounded, 1, 2, "nearest whole number; `round(x, 2)`: to two digits"),
    "floor": Function(math.floor, 1, 1, "largest integer that is not greater"),
    "ceil": Function(math.ceil, 1, 1, "smallest integer that is not less"),
    "sqrt": Function(math.sqrt, 1, 1, "square root"),
    "sin": Function(lambda x: math.sin(math.radians(x)), 1, 1, "sine of an angle in degrees"),
    "cos": Function(lambda x: math.cos(math.radians(x)), 1, 1, "cosine of an angle in degrees"),
    "tan": Function(lambda x: math.tan(math.radians(x)), 1, 1, "tangent of an angle in degrees"),
    "atan2": Function(
        lambda y, x: math.degrees(math.atan2(y, x)),
        2,
        2,
        "angle of the point (x, y) in degrees: `atan2(y, x)`",
    ),
    "norm": Function(_norm, 1, 1, "length of a vector", of_numbers=False),
    "len": Function(
        _length, 1, 1, "number of items of a list, or of characters of a text", of_numbers=False
    ),
    "text": Function(as_text, 1, 1, "a value as text: `'cube' + text({i})`", of_numbers=False),
}
"""Functions by name."""


# Values with expressions in them.


def keys_in(value: Data) -> Iterator[str]:
    """Yields the keys to which a port's value refers, at any depth.

    A malformed expression has no keys: the parser of the file has reported it.
    """
    if isinstance(value, dict):
        for item in value.values():
            yield from keys_in(item)
    elif isinstance(value, list):
        for item in value:
            yield from keys_in(item)
    elif isinstance(value, str):
        key = reference_of(value)
        if key is not None:
            yield key
        elif is_expression(value):
            try:
                yield from parse(value).keys
            except ExpressionError:
                return


def resolved(value: Data, read: Callable[[str], Data]) -> Data:
    """Returns a port's value with references and expressions replaced by their values.

    Args:
        value: Value in YAML notation.
        read: Function from a key to its value; may raise.

    Raises:
        ExpressionError: An expression has no value.
    """
    if isinstance(value, dict):
        return {name: resolved(item, read) for name, item in value.items()}
    if isinstance(value, list):
        return [resolved(item, read) for item in value]
    key = reference_of(value)
    if key is not None:
        return read(key)
    return value_of(parse(value), read) if is_expression(value) else value


def substituted(expression: Expression, replace: Callable[[str], Data]) -> str:
    """Returns the text of an expression with other operands in the place of some references.

    Args:
        expression: The expression.
        replace: Function from a key to the value that stands in its place, or to another reference
            or expression.

    Raises:
        ExpressionError: A value cannot be written in an expression, such as a mapping.
    """

    def written(match: re.Match[str]) -> str:
        value = replace(match[1])
        if reference_of(value) is not None:
            return str(value)
        if is_expression(value):
            return f"({value})"
        return _notation(value, match)

    return REFERENCE.sub(written, expression.text)


def _notation(value: Data, match: re.Match[str]) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"({value!r})" if value < 0 else repr(value)
    if isinstance(value, list):
        return f"[{', '.join(_notation(item, match) for item in value)}]"
    if isinstance(value, str):
        if as_number(value) is not None:
            return f"({value.strip()})"
        if not set(value) & set("'\"\\{}\n"):
            return f"'{value}'"
    message = f"'{match[0]}' is {in_words(value)}, which cannot be combined with keys"
    hint = "write it to a key with 'set', and use the key"
    raise ExpressionError(message, match.start(), match.end(), hint)
