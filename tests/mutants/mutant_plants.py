"""The faults that can be planted in one file: each a small change of its syntax tree.

What is only told to people is left alone: docstrings, messages, what is logged, annotations. So is what any
test would trip over, such as a missing attribute after `__init__`, and what another kind comes to as well.
"""

from __future__ import annotations

import ast
from dataclasses import replace

from mutant_changes import Put, emptying, field_of, if_statement, into, is_or, is_text
from mutant_expressions import Expressions, Place, Plant, tells

_SAID = frozenset({"__repr__", "__str__", "__format__"})


def plants(tree: ast.Module) -> list[Plant]:
    """All that can be planted, in the order of the source."""
    search = _Search()
    search.block(tree.body, Place())
    return search.found


class _Search(Expressions):
    def block(self, body: list[ast.stmt], place: Place) -> None:
        for index, statement in enumerate(body):
            self.statement(statement, into(body, index), place)

    def statement(self, s: ast.stmt, put: Put, place: Place) -> None:
        inside = bool(place.functions)
        place = replace(place, shown=s, reached=s.lineno if inside else None)
        deeper = replace(place, alone=False)
        match s:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                self.function(s, deeper)
            case ast.ClassDef(bases=[ast.Name(id="Enum" | "StrEnum"), *_]):
                # What its members are is nobody's business.
                methods: list[ast.stmt] = [one for one in s.body if isinstance(one, ast.FunctionDef)]
                self.block(methods, replace(deeper, scope=f"{place.scope}{s.name}."))
            case ast.ClassDef():
                self.block(s.body, replace(deeper, scope=f"{place.scope}{s.name}."))
            case ast.Expr(value=ast.Constant() | ast.Yield()) | ast.Assert():
                pass
            case ast.Expr(value=value):
                if not tells(value):
                    self.remove("removed", s, put, place)
                    self.expression(value, field_of(s, "value"), deeper)
            case ast.Delete():
                self.remove("removed", s, put, place)
            case ast.Assign() | ast.AnnAssign() | ast.AugAssign():
                self.assignment(s, put, place)
            case ast.Return(value=None) | ast.Continue():
                self.remove("exit", s, put, place)
            case ast.Break() if place.in_loop:
                self.remove("exit", s, put, place)
            case ast.Return(value=ast.expr() as value):
                self.expression(value, field_of(s, "value"), deeper)
            case ast.Raise():
                self.remove("raise", s, put, place)
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                pass
            case ast.If():
                otherwise = s.orelse[0].lineno if s.orelse else None
                self.condition(s.test, field_of(s, "test"), deeper, s.body[0].lineno, otherwise)
                alone = not s.orelse and len(s.body) == 1 and not is_or(s.test)
                self.block(s.body, replace(place, alone=alone))
                self.block(s.orelse, deeper)
            case ast.While():
                self.expression(s.test, field_of(s, "test"), deeper)
                self.block(s.body, replace(deeper, in_loop=False))
                self.block(s.orelse, deeper)
            case ast.For() | ast.AsyncFor():
                self.expression(s.iter, field_of(s, "iter"), deeper)
                self.block(s.body, replace(deeper, in_loop=True))
                self.block(s.orelse, deeper)
            case ast.With() | ast.AsyncWith():
                self.context(s, put, deeper)
            case ast.Try() | ast.TryStar():
                self.tried(s, deeper)
            case ast.Match():
                self.expression(s.subject, field_of(s, "subject"), deeper)
                for case in s.cases:
                    if case.guard is not None:
                        self.condition(case.guard, field_of(case, "guard"), replace(deeper, shown=case))
                    self.block(case.body, deeper)
            case _:
                pass

    def remove(self, kind: str, s: ast.stmt, put: Put, place: Place) -> None:
        """Never reached instead of gone, so that every name stays a name of the same scope."""
        if place.functions and not place.alone:
            self.add(kind, s, place, lambda: put(if_statement(ast.Constant(False), [s], s)))

    def function(self, s: ast.FunctionDef | ast.AsyncFunctionDef, place: Place) -> None:
        marks = {ast.unparse(decorator).rpartition(".")[2] for decorator in s.decorator_list}
        body = [one for one in s.body if not is_text(one)]
        if not body or s.name in _SAID or marks & {"overload", "abstractmethod"}:
            return
        defaults = replace(place, reached=body[0].lineno)
        for given in (s.args.defaults, s.args.kw_defaults):
            for index, default in enumerate(given):
                if isinstance(default, ast.Constant):
                    self.constant(default, into(given, index), defaults)
        first = min([s.lineno, *(decorator.lineno for decorator in s.decorator_list)])
        key = (f"{place.scope}{s.name}", first)
        inner = Place(functions=(*place.functions, key), scope=f"{key[0]}.<locals>.")
        self.block(s.body, inner)

    def assignment(self, s: ast.Assign | ast.AnnAssign | ast.AugAssign, put: Put, place: Place) -> None:
        targets = s.targets if isinstance(s, ast.Assign) else [s.target]
        names = [target.id for target in targets if isinstance(target, ast.Name)]
        if any(name in ("__slots__", "__all__") for name in names) or s.value is None:
            return
        kept = names if not isinstance(s, ast.AugAssign) else []
        if not kept and not place.scope.endswith("__init__.<locals>."):
            self.remove("removed", s, put, place)
        deeper = replace(place, alone=False)
        if isinstance(s, ast.AugAssign) and place.functions:
            self.operator(s, deeper)
        if not isinstance(s, ast.AugAssign) or not isinstance(s.value, ast.Constant):
            self.expression(s.value, field_of(s, "value"), deeper)

    def context(self, s: ast.With | ast.AsyncWith, put: Put, place: Place) -> None:
        if place.functions and all(item.optional_vars is None for item in s.items):
            self.add("with", s, place, lambda: put(if_statement(ast.Constant(True), s.body, s)))
        for item in s.items:
            self.expression(item.context_expr, field_of(item, "context_expr"), place)
        self.block(s.body, place)

    def tried(self, s: ast.Try | ast.TryStar, place: Place) -> None:
        self.block(s.body, place)
        for handler in s.handlers:
            single = len(handler.body) == 1
            if place.functions and not isinstance(handler.body[0], ast.Pass):
                there = replace(place, reached=handler.body[0].lineno, shown=handler)
                self.add("handler", handler, there, emptying(handler.body))
            self.block(handler.body, replace(place, alone=single))
        self.block(s.orelse, place)
        if s.finalbody and place.functions:
            there = replace(place, reached=s.finalbody[0].lineno, shown=s.finalbody[0])
            self.add("finally", s.finalbody[0], there, emptying(s.finalbody))
        self.block(s.finalbody, replace(place, alone=len(s.finalbody) == 1))
