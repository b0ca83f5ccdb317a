"""Every obstacle has its row: nobody makes one up where it is found."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from app.http import remedies
from drivers import obstacles
from drivers.errors import Gravity, Remedy
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.obstacle_rows import ROWS

ROOT = Path(__file__).parents[2]
TABLES = {Path("drivers/obstacles.py"), Path("drivers/master/axis/obstacle_rows.py")}
KINDS = [kind for kind in vars(obstacles).values() if isinstance(kind, obstacles.ObstacleKind)]


def _called(path: Path) -> set[str]:
    calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    return {
        func.id if isinstance(func, ast.Name) else func.attr
        for func in calls
        if isinstance(func, ast.Name | ast.Attribute)
    }


def test_obstacles_and_their_kinds_are_made_in_the_tables_alone() -> None:
    makers = {
        path.relative_to(ROOT)
        for package in ("app", "drivers")
        for path in (ROOT / package).rglob("*.py")
        if _called(path) & {"Obstacle", "ObstacleKind"}
    }
    assert makers == TABLES


def test_a_kind_that_is_in_the_table_is_found_somewhere() -> None:
    named = {name for name, kind in vars(obstacles).items() if isinstance(kind, obstacles.ObstacleKind)}
    texts = [
        path.read_text()
        for package in ("app", "drivers")
        for path in (ROOT / package).rglob("*.py")
        if path.relative_to(ROOT) != Path("drivers/obstacles.py")
    ]
    assert {name for name in named if not any(name in text for text in texts)} == set()


def test_no_two_rows_say_the_same() -> None:
    kinds = [row.kind for row in ROWS]
    assert len(set(kinds)) == len(kinds)
    said: defaultdict[tuple[str, str], set[obstacles.ObstacleKind]] = defaultdict(set)
    for kind in (*kinds, *KINDS):
        said[kind.code, kind.remedy].add(kind)
    assert [each for each in said.values() if len({kind.gravity for kind in each}) > 1] == []


def test_nothing_prevents_a_stop_and_an_axis_out_of_reach_prevents_all_else() -> None:
    concerned = frozenset[AxisCommand]().union(*(row.concerns for row in ROWS))
    assert concerned == set(AxisCommand) - {AxisCommand.STOP, AxisCommand.QUICK_STOP}
    beyond = [row for row in ROWS if row.kind.gravity >= Gravity.AWAY]
    assert beyond
    assert all(len(row.concerns) == len(AxisCommand) - 2 for row in beyond)


@pytest.mark.parametrize("remedy", Remedy)
def test_the_service_has_a_request_for_every_remedy(remedy: Remedy) -> None:
    action = remedies.action(remedy, 1, 0)
    assert action is not None
    assert action["method"] == "POST"


def test_blanks_of_a_remedy_are_filled_in() -> None:
    assert "bit 3 of" in obstacles.NOT_AN_OUTPUT.found("It is an input.", bit=3).remedy
