"""The faults that can be planted in an expression, and what a plant is."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, replace

from mutant_changes import (
    ANOTHER,
    OPPOSITE,
    OTHER_BOUND,
    OTHER_SIDE,
    Put,
    children,
    constant,
    field_of,
    into,
    is_bool,
    is_empty,
    is_or,
    is_string,
    joined,
    leaving_out,
    setting,
)

_TOLD = frozenset({"log", "_log", "logger", "tell"})
"""Whoever is called to write a log."""
_TYPES_ONLY = frozenset({"cast", "isinstance", "issubclass", "TypeVar", "getattr", "hasattr", "round"})
"""Calls of which only the first argument is looked at."""
_FOR_PEOPLE = frozenset(
    {"name", "hint", "reason", "message", "detail", "doc", "description", "error", "node", "axis"}
)
"""Named arguments that go into a text, an error or a log."""
_INSTANTS = frozenset({"now", "deadline", "due", "time", "until"})
"""Where one of these is compared, no test can meet the very instant."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where in the file one is."""

    reached: int | None = None
    """The line of the statement that must be reached; None: the import alone meets the fault."""
    functions: tuple[tuple[str, int], ...] = ()
    """Around it, from the outermost: qualified name and first line, as in their code objects."""
    scope: str = ""
    in_loop: bool = False
    """Whether the nearest loop is one that ends by itself."""
    alone: bool = False
    """Whether leaving this statement out is another plant already."""
    shown: ast.AST | None = None


@dataclass(frozen=True, slots=True)
class Plant:
    """One fault of one tree, which `change` changes in place; once, and no other plant of it afterwards."""

    kind: str
    line: int
    place: Place
    change: Callable[[], None]
    """Plants it."""

    def difference(self) -> tuple[str, str]:
        """Plant it, and say the line before and after."""
        before, body = self._shown()
        self.change()
        match self.kind:
            case "removed" | "raise" | "exit":
                return before, "pass"
            case "handler":
                return f"{before} {body}", f"{before} pass"
            case "finally":
                return f"finally: {before}", "finally: pass"
            case "with":
                return before, "if True:"
            case _:
                return before, self._shown()[0]

    def _shown(self) -> tuple[str, str]:
        """The statement's line, without decorators, and the first one of its body."""
        assert self.place.shown is not None
        lines = [line.strip() for line in ast.unparse(self.place.shown).splitlines()]
        lines = [line for line in lines if line and not line.startswith("@")]
        return lines[0], lines[1] if len(lines) > 1 else ""


class Expressions:
    """Looks through expressions for what can be planted."""

    def __init__(self) -> None:
        self.found: list[Plant] = []

    def add(self, kind: str, at: ast.AST, place: Place, change: Callable[[], None]) -> None:
        self.found.append(Plant(kind, getattr(at, "lineno", 0), place, change))

    def condition(
        self, test: ast.expr, put: Put, place: Place, held: int | None = None, otherwise: int | None = None
    ) -> None:
        """It is evaluated all the same: what it awaits or names is there.

        `held`, `otherwise`: first lines of what is done then. Who does not reach the one sees nothing of a
        condition that holds more rarely, nor of one that holds more often who does not reach the other.
        """
        if place.functions:
            ways = (
                replace(place, reached=held or place.reached),
                replace(place, reached=otherwise or place.reached),
            )
            join = test.op if isinstance(test, ast.BoolOp) else None
            if not isinstance(join, ast.And):  # there, leaving parts out says as much
                self.add("always", test, ways[1], lambda: put(joined(ast.Or(), test, True)))
            if not isinstance(join, ast.Or):
                self.add("never", test, ways[0], lambda: put(joined(ast.And(), test, False)))
            self.expression(test, put, place, ways=ways)

    def expression(
        self, e: ast.expr, put: Put, place: Place, *, ways: tuple[Place, Place] | None = None
    ) -> None:
        """`ways`: of a condition, where it held and where it did not."""
        if not place.functions:
            self.at_import(e, put, place)
            return
        match e:
            case ast.Constant():
                self.constant(e, put, place)
                return
            case ast.JoinedStr():
                return
            case ast.Call():
                self.call(e, put, place)
                return
            case ast.IfExp():
                self.condition(e.test, field_of(e, "test"), place)
                self.expression(e.body, field_of(e, "body"), place)
                self.expression(e.orelse, field_of(e, "orelse"), place)
                return
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant()):
                self.add("sign", e, place, lambda: put(e.operand))
                return
            case ast.UnaryOp(op=ast.USub()):
                self.add("sign", e, place, lambda: put(e.operand))
            case ast.UnaryOp(op=ast.Not()) if ways is None:
                self.add("not", e, place, lambda: put(e.operand))
            case ast.BoolOp():
                there = place if ways is None else ways[0 if is_or(e) else 1]
                plain = is_or(e) and is_empty(e.values[-1])  # `or 0` is there for the types
                for index, part in enumerate(e.values[:-1] if plain else e.values):
                    self.add("part", part, there, leaving_out(e, index, put))
                    self.expression(part, into(e.values, index), place)
                return
            case ast.Compare():
                self.comparison(e, place, opposite=ways is None)
            case ast.BinOp():
                if isinstance(e.left, ast.JoinedStr) or is_string(e.left) or is_string(e.right):
                    return
                self.operator(e, place)
            case _:
                pass
        for child, instead in children(e):
            self.expression(child, instead, place)

    def at_import(self, e: ast.expr, put: Put, place: Place) -> None:
        """Of a class's or a module's body only its constants, and no times: how long is long enough?"""
        if isinstance(e, ast.Constant):
            if not isinstance(e.value, float):
                self.constant(e, put, place)
        elif not isinstance(e, ast.JoinedStr | ast.Subscript):
            for child, instead in children(e):
                self.at_import(child, instead, place)

    def comparison(self, e: ast.Compare, place: Place, *, opposite: bool) -> None:
        named = {getattr(n, "id", None) or getattr(n, "attr", "") for n in ast.walk(e)}
        instant = any(name in _INSTANTS or name.endswith("_at") for name in named)
        for index, op in enumerate(e.ops):
            if opposite:
                self.add("compare", e, place, setting(e.ops, index, OPPOSITE[type(op)]()))
            if type(op) in OTHER_SIDE and not instant:
                self.add("edge", e, place, setting(e.ops, index, OTHER_SIDE[type(op)]()))

    def operator(self, e: ast.BinOp | ast.AugAssign, place: Place) -> None:
        other = ANOTHER.get(type(e.op))
        if other is not None:
            self.add("arith", e, place, lambda: setattr(e, "op", other()))

    def call(self, e: ast.Call, put: Put, place: Place) -> None:
        if tells(e):
            return
        named = e.func.id if isinstance(e.func, ast.Name) else None
        if named in OTHER_BOUND:
            instead = ast.copy_location(ast.Name(OTHER_BOUND[named], ast.Load()), e.func)
            self.add("bound", e, place, lambda: setattr(e, "func", instead))
        self.expression(e.func, field_of(e, "func"), place)
        for index, given in enumerate(e.args[:1] if named in _TYPES_ONLY else e.args):
            self.expression(given, into(e.args, index), place)
        for keyword in e.keywords:
            if keyword.arg in _FOR_PEOPLE:
                continue
            if keyword.arg is not None and not is_bool(keyword.value):  # else flipping says as much
                self.add("keyword", keyword, place, lambda keyword=keyword: e.keywords.remove(keyword))
            self.expression(keyword.value, field_of(keyword, "value"), place)

    def constant(self, e: ast.Constant, put: Put, place: Place) -> None:
        value = e.value
        if isinstance(value, bool):
            self.add("bool", e, place, lambda: put(constant(not value, e)))
        elif isinstance(value, int):
            self.add("number", e, place, lambda: put(constant(value + 1, e)))
        elif isinstance(value, float):
            self.add("number", e, place, lambda: put(constant(2 * value or 1.0, e)))


def tells(e: ast.expr) -> bool:
    """Whether it only writes a log."""
    while isinstance(e, ast.Call | ast.Attribute):
        e = e.func if isinstance(e, ast.Call) else e.value
    return isinstance(e, ast.Name) and e.id in _TOLD
