"""Small changes of a syntax tree: what stands for what, and how one node takes another's place."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from typing import Any

KINDS = {
    "always": "a condition holds always",
    "never": "a condition never holds",
    "part": "one part of an `and` or `or` is left out",
    "not": "a `not` is left out",
    "compare": "a comparison says the opposite",
    "edge": "a limit belongs to the other side",
    "arith": "another operator: + and -, * and /, & and |, << and >>",
    "sign": "a minus is left out",
    "bound": "min for max, any for all, and the other way round",
    "number": "a whole number is one more, another one twice as large",
    "bool": "True for False and the other way round",
    "keyword": "a named argument is left out",
    "removed": "a call, an assignment or an await is left out",
    "raise": "an error is not raised",
    "exit": "a `return`, `continue` or `break` is left out",
    "handler": "what is done about an error is left out",
    "finally": "what is done in any case is left out",
    "with": "a block runs without its `with`",
}

Put = Callable[[ast.AST], None]
"""Puts something in the place of a node."""

OPPOSITE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OTHER_SIDE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
ANOTHER: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
OTHER_BOUND = {"min": "max", "max": "min", "any": "all", "all": "any"}


def children(e: ast.AST) -> Iterator[tuple[ast.expr, Put]]:
    """The expressions right below, also through comprehensions and slices."""
    for field, value in ast.iter_fields(e):
        if isinstance(value, ast.expr):
            yield value, field_of(e, field)
        elif isinstance(value, ast.AST):
            yield from children(value)
        elif isinstance(value, list):
            for index, one in enumerate(value):
                if isinstance(one, ast.expr):
                    yield one, into(value, index)
                elif isinstance(one, ast.AST):
                    yield from children(one)


def field_of(owner: ast.AST, field: str) -> Put:
    return lambda node: setattr(owner, field, node)


def into(nodes: list[Any], index: int) -> Put:
    return lambda node: nodes.__setitem__(index, node)


def setting(ops: list[ast.cmpop], index: int, op: ast.cmpop) -> Callable[[], None]:
    return lambda: ops.__setitem__(index, op)


def emptying(body: list[ast.stmt]) -> Callable[[], None]:
    return lambda: body.__setitem__(slice(None), [if_statement(ast.Constant(False), list(body), body[0])])


def leaving_out(e: ast.BoolOp, index: int, put: Put) -> Callable[[], None]:
    rest = [*e.values[:index], *e.values[index + 1 :]]
    return lambda: put(rest[0] if len(rest) == 1 else ast.copy_location(ast.BoolOp(e.op, rest), e))


def if_statement(test: ast.expr, body: list[ast.stmt], like: ast.stmt) -> ast.If:
    return ast.fix_missing_locations(ast.copy_location(ast.If(test, body, []), like))


def joined(op: ast.boolop, test: ast.expr, value: bool) -> ast.expr:
    return ast.fix_missing_locations(ast.copy_location(ast.BoolOp(op, [test, ast.Constant(value)]), test))


def constant(value: float, like: ast.expr) -> ast.Constant:
    return ast.copy_location(ast.Constant(value), like)


def is_text(s: ast.stmt) -> bool:
    return isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)


def is_string(e: ast.expr) -> bool:
    return isinstance(e, ast.Constant) and isinstance(e.value, str)


def is_bool(e: ast.expr) -> bool:
    return isinstance(e, ast.Constant) and isinstance(e.value, bool)


def is_empty(e: ast.expr) -> bool:
    """0, None, "", (), [] or {}."""
    if isinstance(e, ast.Constant):
        return not e.value
    return ast.unparse(e) in ("()", "[]", "{}")


def is_or(e: ast.expr) -> bool:
    return isinstance(e, ast.BoolOp) and isinstance(e.op, ast.Or)
