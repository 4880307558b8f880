"""Small errors that a source may be given: another operator, comparison, number or condition, a statement left out.

mutmut leaves functions with decorators out, which all kernels are; cosmic-ray needs a package that has no wheel.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import NamedTuple

BINARY = {
    "+": ("-",),
    "-": ("+",),
    "*": ("/", "+"),
    "/": ("*",),
    "//": ("*",),
    "%": ("//",),
    "**": ("*",),
    "&": ("|",),
    "|": ("&",),
    "^": ("&",),
}
COMPARISONS = {
    "<": ("<=", ">"),
    "<=": ("<", ">"),
    ">": (">=", "<"),
    ">=": (">", "<"),
    "==": ("!=",),
    "!=": ("==",),
    "is": ("is not",),
    "is not": ("is",),
    "in": ("not in",),
    "not in": ("in",),
}
BOOLEAN = {"and": ("or",), "or": ("and",)}


class Change(NamedTuple):
    """What stands at bytes [first, last) of a source, and what is put there."""

    first: int
    last: int
    text: str

    def made(self, source: str) -> str:
        """The source with the change in it."""
        raw = source.encode()
        return (raw[: self.first] + self.text.encode() + raw[self.last :]).decode()


def changes(source: str) -> list[Change]:
    """Every change of what runs; none of annotations, docstrings, descriptions of parameters and messages."""
    text = _Text(source)
    return [change for node in _running(ast.parse(source)) for change in text.changes_at(node)]


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """A node and those below it, but for annotations and what is under them."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _running(child)


class _Text:
    """A source by bytes, as the tree counts them."""

    def __init__(self, source: str) -> None:
        self.raw = source.encode()
        lines = self.raw.splitlines(keepends=True)
        self.starts = [sum(len(one) for one in lines[:k]) for k in range(len(lines) + 1)]

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        first = self.starts[node.lineno - 1] + node.col_offset
        return first, self.starts[node.end_lineno - 1] + node.end_col_offset

    def changes_at(self, node: ast.AST) -> Iterator[Change]:
        match node:
            case ast.BinOp():
                yield from self._between(node.left, node.right, BINARY)
            case ast.Compare(ops=[_]):
                yield from self._between(node.left, node.comparators[0], COMPARISONS)
            case ast.BoolOp():
                yield from self._between(node.values[0], node.values[1], BOOLEAN)
            case ast.UnaryOp():
                first = self.span(node)[0]
                yield Change(first, first + (3 if isinstance(node.op, ast.Not) else 1), " ")
            case ast.Constant(value=bool()):
                yield Change(*self.span(node), str(not node.value))
            case ast.Constant(value=int() | float()):
                yield from (Change(*self.span(node), f"({other!r})") for other in _near(node.value))
            case ast.If() | ast.While() | ast.IfExp():
                first, last = self.span(node.test)
                yield Change(first, last, f"not ({self.raw[first:last].decode()})")
            case ast.AugAssign() | ast.Expr(value=ast.Call()):
                yield Change(*self.span(node), "pass")
            case ast.Break():
                yield Change(*self.span(node), "continue")
            case ast.Continue():
                yield Change(*self.span(node), "break")

    def _between(self, left: ast.expr, right: ast.expr, others: dict[str, tuple[str, ...]]) -> Iterator[Change]:
        """Other operators in the place of the one between two operands; parentheses stay."""
        first, last = self.span(left)[1], self.span(right)[0]
        between = self.raw[first:last].decode()
        known = between.strip("() \n\\")
        at = first + len(between[: between.index(known)].encode())
        yield from (Change(at, at + len(known.encode()), other) for other in others.get(known, ()))


def _near(number: float) -> tuple[float, ...]:
    if isinstance(number, int):
        return number + 1, number - 1
    return (0.5 * number, 2.0 * number) if number else (1.0,)
