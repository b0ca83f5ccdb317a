"""Mutants: the product with one fault, known by where and what it is."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

from mutant_plants import plants


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault of one file."""

    file: str
    """From the repository's root."""
    line: int
    kind: str
    number: int
    """Among those of its kind and line, from 1."""
    index: int
    """Among all of the file."""
    reached: int | None
    """Line of the statement that must be reached; None: any import meets the fault."""
    functions: tuple[tuple[str, int], ...]
    """Around it, from the outermost: qualified name and first line."""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.kind}" + (f".{self.number}" if self.number > 1 else "")


def mutants_of(root: Path, file: str) -> list[Mutant]:
    """Every mutant of a file, in the order of its source."""
    found: list[Mutant] = []
    counts: dict[tuple[int, str], int] = {}
    for index, plant in enumerate(plants(ast.parse((root / file).read_bytes()))):
        number = counts[plant.line, plant.kind] = counts.get((plant.line, plant.kind), 0) + 1
        place = plant.place
        found.append(Mutant(file, plant.line, plant.kind, number, index, place.reached, place.functions))
    return found


def planted(tree: ast.Module, index: int) -> ast.Module:
    """The file with its mutant of that index; the tree is changed in place."""
    plants(tree)[index].change()
    return tree


def difference(root: Path, mutant: Mutant) -> tuple[str, str]:
    """The changed line, before and after."""
    return plants(ast.parse((root / mutant.file).read_bytes()))[mutant.index].difference()
