"""Plants a fault in functions that are imported already: each gets the code that it has with the fault."""

from __future__ import annotations

import ast
import gc
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType

from mutant import Mutant, planted
from mutant_hook import compiled

Key = tuple[str, str, int]
"""File, qualified name, first line."""


def functions_of(root: Path, files: set[str]) -> dict[Key, list[FunctionType]]:
    """Every function that these files' imported modules made, wherever it is kept and whatever wraps it."""
    paths = {str(root / file) for file in files}
    found: dict[Key, list[FunctionType]] = {}
    for thing in gc.get_objects():
        if isinstance(thing, FunctionType) and thing.__code__.co_filename in paths:
            found.setdefault(_key(thing.__code__), []).append(thing)
    return found


def plant(root: Path, mutant: Mutant, functions: dict[Key, list[FunctionType]]) -> bool:
    """Give the fault to the functions around it; False if there are none, or their closures don't fit."""
    path = str(root / mutant.file)
    changed = {_key(code): code for code in _codes(compiled(path, lambda tree: _with(tree, mutant)))}
    done = False
    for name, line in mutant.functions:
        key = (path, name, line)
        for function in functions.get(key, ()):
            try:
                function.__code__ = changed[key]
            except (KeyError, ValueError):
                return False
            done = True
    return done


def _with(tree: ast.Module, mutant: Mutant) -> ast.Module:
    return planted(tree, mutant.index)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _key(code: CodeType) -> Key:
    return code.co_filename, code.co_qualname, code.co_firstlineno
