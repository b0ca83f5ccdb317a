"""docs/faults.md against the tests that it names, and against the table of problems."""

from __future__ import annotations

import ast
import re

import pytest
from repository import ROOT

from app.http.problems import PROBLEM_TYPES
from drivers.master.seen.status import NodeState

TESTS = ROOT / "tests"
PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
NAMED = re.compile(r"`(test_\w+\.py)(?:::(test_\w+))?`")
FILES = {path.name: path for path in TESTS.rglob("test_*.py")}
ROWS = [
    line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith(("| fault", "| trap"))
]


def functions(file: str) -> set[str]:
    tree = ast.parse(FILES[file].read_text(encoding="utf-8"))
    return {
        each.name
        for each in tree.body
        if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef) and each.name.startswith("test_")
    }


def test_there_is_a_row_for_every_fault() -> None:
    assert len(ROWS) >= 40


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_each_row_names_tests_that_are_there(row: str) -> None:
    named = NAMED.findall(row.rsplit("|", 2)[1])
    assert named, "a fault without a test"
    for file, function in named:
        assert file in FILES, file
        assert not function or function in functions(file), f"{file}::{function}"


def test_every_test_of_the_faults_is_named() -> None:
    named = set(NAMED.findall(PAGE))
    for file in FILES:
        if file.startswith("test_faults_of_"):
            assert {(file, function) for function in functions(file)} <= named


def test_the_statuses_and_codes_are_those_of_the_table() -> None:
    said = re.findall(r"\b([45]\d\d) `(\w+)`", PAGE) + [
        (status, code) for code, status in re.findall(r"`(\w+)` \(([45]\d\d)\)", PAGE)
    ]
    assert len(said) > 15
    for status, code in said:
        assert PROBLEM_TYPES[code].status == int(status), code


def test_the_states_of_nodes_exist() -> None:
    said = re.findall(r"node `(\w+)`", PAGE)
    assert set(said) <= {state.value for state in NodeState}
    assert len(said) > 3


def test_each_threat_names_tests_that_are_there() -> None:
    """docs/security.md: every row of its first table."""
    page = (TESTS.parent / "docs" / "security.md").read_text(encoding="utf-8")
    table = page.split("| threat |", 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    assert len(table) > 15
    for row in table:
        named = NAMED.findall(row.rsplit("|", 2)[1])
        assert named, f"a threat without a test: {row}"
        for file, function in named:
            assert file in FILES, file
            assert not function or function in functions(file), f"{file}::{function}"


def test_no_word_promises_more_than_a_software_stop() -> None:
    """Of an emergency stop, and of what it takes to be one, we only say that this is none."""
    root = TESTS.parent
    pages = [root / "README.md", root / "openapi" / "openapi.json", *root.glob("docs/**/*.md")]
    pages += [*root.glob("openapi/*.md"), *root.glob("app/**/*.py"), *root.glob("canaxis/**/*.py")]
    said = 0
    for page in pages:
        text = re.sub(r"(?:\s|\\n|\*)+", " ", page.read_text(encoding="utf-8"))
        for found in re.finditer(r"emergency[ -]?stop|\be-stop\b", text, re.IGNORECASE):
            said += 1
            assert re.search(r"\b(no|not an|neither an) $", text[: found.start()]), (page, found)
    assert said >= 3, "README, API and docs/safety.md say so"
