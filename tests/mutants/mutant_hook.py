"""Changes modules as they are imported: a fault in one of them, or a note of each statement that is reached.

Nothing is written beside the sources, no byte code either. What to do is said by the environment, so that
processes which a test starts do it too (`sitecustomize`).
"""

from __future__ import annotations

import ast
import builtins
import importlib.machinery
import importlib.util
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import CodeType, ModuleType

from mutant import planted

PLANTED, PROBED = "MUTANT_PLANTED", "MUTANT_PROBED"
"""Environment: which fault of which file; which files to watch, and where to note what is reached."""

NOTE = "__mutant_reached__"
"""The function, among the builtins, that a watched statement calls with its number."""

Change = Callable[[ast.Module], ast.Module]


class _Finder:
    """Finds modules as everybody else does, and gives some of them another loader."""

    def __init__(self, changes: Mapping[str, Change]) -> None:
        self._changes = changes

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        for finder in sys.meta_path:
            find = getattr(finder, "find_spec", None)
            if finder is self or find is None:
                continue
            spec = find(name, path, target)
            if spec is not None:
                if spec.origin in self._changes:
                    spec.loader = _Loader(name, spec.origin, self._changes[spec.origin])
                return spec
        return None


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, change: Change) -> None:
        super().__init__(name, path)
        self._change = change

    def get_code(self, fullname: str) -> CodeType:
        return compiled(self.path, self._change)


def compiled(path: str, change: Change) -> CodeType:
    """A file's code, changed; its byte code is neither read nor written."""
    tree = change(ast.parse(Path(path).read_bytes()))
    return compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True)


def install(changes: Mapping[str, Change]) -> None:
    """From now on, change these files (by absolute path) as they are imported."""
    sys.meta_path.insert(0, _Finder(changes))


def install_as_told() -> None:
    """Do what the environment says."""
    if PLANTED in os.environ:
        told = json.loads(os.environ[PLANTED])
        install({told["file"]: lambda tree: planted(tree, told["index"])})
    if PROBED in os.environ:
        told = json.loads(os.environ[PROBED])
        install({file: _watching(number) for number, file in enumerate(told["files"])})
        setattr(builtins, NOTE, _noting(Path(told["into"]), os.environ.get("PYTEST_CURRENT_TEST")))


def environment(root: Path, **more: str) -> dict[str, str]:
    """This process's, for Python processes that heed `PLANTED` and `PROBED` and import what is in `root`."""
    paths = [str(Path(__file__).parent), str(root), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | more


# --- which statements are reached ---

LINES = 1 << 16
"""A statement's number is its file's times this, plus its line."""


def _watching(number: int) -> Change:
    def change(tree: ast.Module) -> ast.Module:
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                _watch(node, number)
        return tree

    return change


def _watch(function: ast.FunctionDef | ast.AsyncFunctionDef, number: int) -> None:
    """Have each statement note that it is reached; those of functions inside are theirs."""
    blocks: list[ast.AST] = [function]
    while blocks:
        owner = blocks.pop()
        for field, value in ast.iter_fields(owner):
            if not isinstance(value, list):
                continue
            if field in ("handlers", "cases"):
                blocks += value
            elif field in ("body", "orelse", "finalbody"):
                statements = list(value)
                inside = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef
                blocks += [one for one in statements if not isinstance(one, inside)]
                value[:] = [piece for one in statements for piece in _noted(one, number)]


def _noted(statement: ast.stmt, number: int) -> list[ast.stmt]:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return [statement]  # a docstring is the first statement, or none
    note = ast.parse(f"{NOTE}({number * LINES + statement.lineno})").body[0]
    ast.copy_location(note, statement)
    return [note, statement]


def _noting(folder: Path, test: str | None) -> Callable[[int], object]:
    """In a process that a test started: what is reached is written down at once, since it may be killed."""
    seen: set[int] = set()
    if test is None:
        return seen.add
    file = os.open(folder / f"{os.getpid()}.beside", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, f"{test.rpartition(' (')[0]}\n".encode())

    def note(number: int) -> None:
        if number not in seen:
            seen.add(number)
            os.write(file, b"%d\n" % number)

    return note
