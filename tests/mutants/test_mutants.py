"""The tool that plants faults: on a small product with tests, some of which are blind."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mutant import mutants_of
from mutant_plants import plants
from mutant_report import Accepted, shortened
from mutant_scope import FILES, LEFT_ALONE, chosen, matches

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]

PRODUCT = '''\
"""A drive, more or less."""

LIMIT = 3


def held(wanted: int) -> int:
    if wanted > LIMIT:
        return LIMIT
    return wanted


class Drive:
    def __init__(self) -> None:
        self.energised = True
        self.told = 0

    def stop(self) -> None:
        self.energised = False
        self.tell()

    def tell(self) -> None:
        self.told += 1

    def coast(self) -> int:
        left = 3
        while left > 0:
            left = left - 1
        return left

    def never_tried(self) -> bool:
        return True


def beside() -> bool:
    return True
'''

TESTS = """\
import subprocess
import sys

from product import Drive, held


def test_it_is_held_to_a_limit() -> None:
    assert (held(1), held(4)) == (1, 3)


def test_it_stops() -> None:
    drive = Drive()
    drive.stop()
    assert not drive.energised


def test_it_coasts() -> None:
    assert Drive().coast() == 0


def test_a_process_beside() -> None:
    command = [sys.executable, "-c", "import product; assert product.beside()"]
    assert subprocess.run(command).returncode == 0


def test_that_fails_by_itself() -> None:
    assert held(1) == 2
"""


ACCEPTED = """\
# Why.
product.py edge: if wanted > LIMIT:
    The limit is
    the limit.
product.py sign: return -wanted
    No.
"""


def planted(source: str) -> list[tuple[str, str, str]]:
    """Kind, and the line before and after, of all that can be planted."""
    found: list[tuple[str, str, str]] = []
    for index in range(len(plants(ast.parse(source)))):
        plant = plants(ast.parse(source))[index]
        found.append((plant.kind, *plant.difference()))
    return found


def in_function(*lines: str) -> list[tuple[str, str, str]]:
    return planted("async def f(self):\n" + "".join(f"    {line}\n" for line in lines))


@pytest.mark.parametrize(
    ("line", "kind", "after"),
    [
        ("self.go(1)", "removed", "pass"),
        ("await self.rest()", "removed", "pass"),
        ("self.speed = a", "removed", "pass"),
        ("count += 1", "removed", "pass"),
        ("return a and b", "part", "return b"),
        ("return a or b or c", "part", "return a or c"),
        ("return not a", "not", "return a"),
        ("return a == b", "compare", "return a != b"),
        ("return a <= b", "edge", "return a < b"),
        ("return a + b", "arith", "return a - b"),
        ("return -a", "sign", "return a"),
        ("return min(a, b)", "bound", "return max(a, b)"),
        ("return 7", "number", "return 8"),
        ("return 0.5", "number", "return 1.0"),
        ("self.halt(urgent=True)", "bool", "self.halt(urgent=False)"),
        ("self.halt(again=self.halt)", "keyword", "self.halt()"),
        ("return a if b else c", "never", "return a if b and False else c"),
    ],
)
def test_a_line_gets_this_fault(line: str, kind: str, after: str) -> None:
    assert (kind, line, after) in in_function(line)


def test_blocks_get_these_faults() -> None:
    found = in_function(
        "for one in self.all:",
        "    if one.lost:",
        "        self.count()",
        "        continue",
        "    with suppress(BusError):",
        "        one.halt()",
        "try:",
        "    self.go()",
        "except BusError:",
        "    self.lose()",
        "    raise",
        "finally:",
        "    self.rest()",
    )
    assert ("always", "if one.lost:", "if one.lost or True:") in found
    assert ("exit", "continue", "pass") in found
    assert ("with", "with suppress(BusError):", "if True:") in found
    assert ("handler", "except BusError: self.lose()", "except BusError: pass") in found
    assert ("raise", "raise", "pass") in found
    assert ("finally", "finally: self.rest()", "finally: pass") in found


def test_what_is_only_told_is_left_alone() -> None:
    source = '''
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    LEVEL = 1
class Axis:
    """One of 3."""
    __slots__ = ("a",)
    left: int | None
    def __repr__(self) -> str:
        return "axis" + str(1)
    def f(self, a: int | None) -> None:
        """Takes 1."""
        log.info("moved", by=1)
        assert a != 1
        raise BadValue(f"{a + 1}", hint="Use 2 or -3.")
'''
    assert planted(source) == [("raise", "raise BadValue(f'{a + 1}', hint='Use 2 or -3.')", "pass")]


def test_what_makes_no_difference_is_left_alone() -> None:
    assert in_function("return position or 0") == [("part", "return position or 0", "return 0")]
    assert [kind for kind, *_ in in_function("self.count += 1")] == ["removed", "arith"]
    assert planted("class Way(Enum):\n    UP = 1\n") == []
    assert len(planted("class Bit(IntFlag):\n    HALT = 256\n")) == 1


def test_a_fault_that_another_one_is_already_is_planted_once() -> None:
    kinds = [kind for kind, *_ in in_function("if self.turns:", "    self.halt()")]
    assert kinds == ["always", "never"]


def test_a_left_out_statement_keeps_its_names_in_their_scope() -> None:
    tree = ast.parse(
        "def f():\n    def g():\n        nonlocal a\n        a += 1\n    a = 1\n    g()\n    return a\n"
    )
    next(plant for plant in plants(tree) if plant.kind == "removed" and plant.line == 4).change()
    scope: dict[str, object] = {}
    exec(compile(tree, "f", "exec"), scope)
    function = scope["f"]
    assert callable(function)
    assert function() == 1


def test_patterns_cover_what_moves_motors() -> None:
    files = chosen(REPOSITORY, FILES, LEFT_ALONE)
    assert all(chosen(REPOSITORY, [pattern], LEFT_ALONE) for pattern in FILES), "a pattern without a file"
    assert "drivers/cia402/setpoint.py" in files
    assert not [file for file in files if file.endswith(("__init__.py", "schemas.py"))]
    assert matches("app/jog/socket.py", "app/**.py")


def test_accepted_survivors_are_known_by_their_line(tmp_path: Path) -> None:
    (tmp_path / "product.py").write_text(PRODUCT)
    mutants = mutants_of(tmp_path, "product.py")
    accepted = Accepted(ACCEPTED)
    edge = next(mutant for mutant in mutants if mutant.kind == "edge")
    assert accepted.reason(tmp_path, edge) == "The limit is the limit."
    assert accepted.reason(tmp_path, mutants[0]) is None
    assert accepted.stale(tmp_path, mutants) == ["product.py sign: return -wanted"]


def test_a_long_line_is_shown_where_it_changes() -> None:
    before, after = shortened("x" * 300 + "a" + "y" * 300, "x" * 300 + "b" + "y" * 300)
    assert before == "... " + "x" * 50 + "a" + "y" * 49 + " ..."
    assert len(after) == len(before)
    assert "b" in after


def test_those_that_no_test_sees_are_printed_and_nothing_is_changed(tmp_path: Path) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "product.py").write_text(PRODUCT)
    (tmp_path / "tests" / "test_product.py").write_text(TESTS)
    command = [sys.executable, HERE, "--root", tmp_path, "--files", "product.py", "--slack", "1"]
    ran = subprocess.run(
        [*command, "--fail-under", "99"],
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert ran.returncode == 1, ran.stderr
    _, *blocks = ran.stdout.split("\n\n")
    survivors = {block.splitlines()[0]: block for block in blocks if block.startswith("product.py")}
    assert set(survivors) == {
        "product.py:7:edge",  # 3 held to 3 is 3
        "product.py:14:bool",
        "product.py:15:number",
        "product.py:19:removed",
        "product.py:22:removed",
        "product.py:22:arith",
        "product.py:25:number",  # four steps end as three do
        "product.py:31:bool",
    }
    assert (
        "- self.tell()\n    + pass\n    1 test ran: test_product.py 1" in survivors["product.py:19:removed"]
    )
    assert "no test reaches it" in survivors["product.py:31:bool"]
    assert "test_that_fails_by_itself" in ran.stdout
    assert "of 1 files were tried" in blocks[-1]
    changed = {file.name for file in tmp_path.rglob("*") if "mutants" not in str(file.relative_to(tmp_path))}
    assert changed - {"__pycache__"} == {"product.py", "tests", "test_product.py", *_byte_code(tmp_path)}
    assert (tmp_path / "product.py").read_text() == PRODUCT


def _byte_code(folder: Path) -> set[str]:
    return {file.name for file in folder.rglob("*.pyc")}
