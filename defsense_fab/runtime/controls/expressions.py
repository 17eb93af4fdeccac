"""Compile formulas of named numbers, such as "bend_up - bend_down" or "clip(2 * twist, 0, 1)".

Python's parser reads a formula, which is then compiled into nested functions. Only the listed
operations and functions are accepted, and no text is ever executed.
"""

from __future__ import annotations

import ast
import difflib
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import NoReturn

from ...core.errors import ControlError

Values = Mapping[str, float]
Evaluate = Callable[[Values], float]

_MAX_CHARACTERS = 500
_MAX_DEPTH = 40  # nested operations

_BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
_UNARY: dict[type, Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_COMPARISONS: dict[type, Callable[[float, float], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


def _clip(x: float, low: float, high: float) -> float:
    return min(max(x, low), high)


#: Function, smallest and largest number of arguments.
_FUNCTIONS: dict[str, tuple[Callable[..., float], int, int]] = {
    "min": (min, 2, 20),
    "max": (max, 2, 20),
    "abs": (abs, 1, 1),
    "clip": (_clip, 3, 3),
}


@dataclass(frozen=True)
class Expression:
    """A compiled formula.

    Attributes:
        text: The formula.
        names: The names that it uses.
        evaluate: Function from the values of the names to the formula's value.
    """

    text: str
    names: frozenset[str]
    evaluate: Evaluate

    def __call__(self, values: Values) -> float:
        """Return its value, or 0 if that is not finite, as after a division by zero."""
        try:
            value = self.evaluate(values)
        except (ArithmeticError, ValueError):
            return 0.0
        return value if math.isfinite(value) else 0.0


def compile_expression(text: str, known: Collection[str]) -> Expression:
    """Compile a formula.

    Args:
        text: The formula; it may span several lines.
        known: Names that it may use.

    Raises:
        ControlError: The formula is invalid; the data has the `column` of the problem.
    """
    if len(text) > _MAX_CHARACTERS:
        raise ControlError(
            f"the formula has {len(text)} characters; the limit is {_MAX_CHARACTERS}",
            code="formula-too-long",
            limit=_MAX_CHARACTERS,
        )
    line = " ".join(text.splitlines())  # files may have formulas over several lines
    indent = len(line) - len(line.lstrip())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers that run into names: refused below
            tree = ast.parse(line[indent:], mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column = max(getattr(error, "offset", None) or 1, 1) + indent
        why = getattr(error, "msg", None) or str(error)
        raise ControlError(
            f"is not a valid formula ({why})",
            code="formula-invalid",
            where=f"{text!r}, column {column}",
            column=column,
        ) from None
    builder = _Builder(text, indent, known)
    evaluate = builder.build(tree, 0)
    return Expression(text, frozenset(builder.used_names), evaluate)


class _Builder:
    """Compiler of the nodes of one formula into functions."""

    def __init__(self, text: str, indent: int, known: Collection[str]) -> None:
        self._text, self._indent, self._known = text, indent, known
        self.used_names: set[str] = set()

    def build(self, node: ast.AST, depth: int) -> Evaluate:
        if depth > _MAX_DEPTH:
            self._fail(
                node,
                f"more than {_MAX_DEPTH} operations are nested",
                "formula-too-deep",
                "Split the formula into two controls",
            )
        if isinstance(node, ast.Constant):
            return self._number(node)
        if isinstance(node, ast.Name):
            return self._name(node)
        if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
            sign, inner = _UNARY[type(node.op)], self.build(node.operand, depth + 1)
            return lambda values: sign(inner(values))
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            join = _BINARY[type(node.op)]
            left, right = self.build(node.left, depth + 1), self.build(node.right, depth + 1)
            return lambda values: join(left(values), right(values))
        if isinstance(node, ast.Compare) and all(type(op) in _COMPARISONS for op in node.ops):
            return self._comparison(node, depth)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self._call(node, node.func.id, depth)
        return self._fail(
            node,
            "this operation is not supported",
            "formula-unsupported",
            "Use numbers, names, + - * / **, < <= > >= == != and the functions"
            f" {', '.join(_FUNCTIONS)}",
        )

    def _number(self, node: ast.Constant) -> Evaluate:
        # A bool is an int, too. Integers beyond the range of a float overflow.
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            self._fail(node, f"{node.value!r} is not a number", "not-a-number")
        try:
            number = float(node.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self._fail(node, "the number is too large", "number-too-large")
        return lambda _values: number

    def _name(self, node: ast.Name) -> Evaluate:
        name = node.id
        if name not in self._known:
            matches = difflib.get_close_matches(name, sorted(self._known), n=1)
            hint = f"did you mean {matches[0]!r}? " if matches else ""
            names = ", ".join(sorted(self._known)) or "none"
            self._fail(
                node,
                f"unknown name {name!r}; {hint}known names: {names}",
                "unknown-name",
                name=name,
                suggestion=matches[0] if matches else None,
            )
        self.used_names.add(name)
        return lambda values: values[name]

    def _comparison(self, node: ast.Compare, depth: int) -> Evaluate:
        parts = [self.build(n, depth + 1) for n in (node.left, *node.comparators)]
        tests = [_COMPARISONS[type(op)] for op in node.ops]

        def compare(values: Values) -> float:
            numbers = [part(values) for part in parts]
            pairs = zip(tests, numbers[:-1], numbers[1:], strict=True)
            return float(all(test(a, b) for test, a, b in pairs))

        return compare

    def _call(self, node: ast.Call, name: str, depth: int) -> Evaluate:
        if name not in _FUNCTIONS:
            self._fail(
                node,
                f"unknown function {name!r}; known functions: {', '.join(_FUNCTIONS)}",
                "unknown-function",
                name=name,
            )
        function, minimum, maximum = _FUNCTIONS[name]
        if node.keywords or not minimum <= len(node.args) <= maximum:
            count = f"{minimum}" if minimum == maximum else f"{minimum} or more"
            self._fail(
                node,
                f"{name} takes {count} positional values",
                "wrong-argument-count",
                function=name,
            )
        arguments = [self.build(n, depth + 1) for n in node.args]
        return lambda values: function(*(argument(values) for argument in arguments))

    def _fail(
        self, node: ast.AST, problem: str, code: str, action: str = "", **data: object
    ) -> NoReturn:
        column = getattr(node, "col_offset", 0) + self._indent + 1
        raise ControlError(
            problem,
            code=code,
            where=f"{self._text!r}, column {column}",
            action=action,
            **data | {"column": column},
        )
