"""The pages that say where things are, against the repository: paths, links, and counts of files."""

from __future__ import annotations

import re

import pytest
from repository import ROOT

GUIDES = ("docs/architecture.md", "docs/testing.md", "docs/where-to-change.md", "docs/words.md")
PAGES = sorted(
    str(page.relative_to(ROOT))
    for page in (ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md"))
)
ROOMS = ("", "drivers/master", "app")
"""Where a path may begin: a table of a house's rooms needs no address in each line."""
QUOTED = re.compile(r"`([^`\n]+)`")
PATH = re.compile(r"[\w.*-]+(?:/[\w.*-]+)*/?")
LINK = re.compile(r"\]\(([^)\s]+)\)")
ENDINGS = (".py", ".md", ".toml", ".json")
ROW = re.compile(r"^\| (?P<what>.+?) \| (?P<files>.+?) \| (?P<count>\d+|–) \| (?P<tests>.+) \|$", re.M)
CHANGES = list(ROW.finditer((ROOT / "docs/where-to-change.md").read_text(encoding="utf-8")))


def paths(text: str) -> list[str]:
    """What is written as a path in backticks: not `GET /api`, not `steps`."""
    return [
        quoted
        for quoted in QUOTED.findall(text)
        if PATH.fullmatch(quoted) and ("/" in quoted or quoted.endswith(ENDINGS))
    ]


def is_there(path: str) -> bool:
    """A name alone may be that of a test, whose room is clear from the sentence."""
    if "/" not in path and next((ROOT / "tests").rglob(path), None):
        return True
    return any(next((ROOT / room).glob(path.rstrip("/")), None) for room in ROOMS)


@pytest.mark.parametrize("page", GUIDES)
def test_every_path_is_there(page: str) -> None:
    named = paths((ROOT / page).read_text(encoding="utf-8"))
    assert not [path for path in named if not is_there(path)]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_within_the_repository_leads_somewhere(page: str) -> None:
    links = LINK.findall((ROOT / page).read_text(encoding="utf-8"))
    inside = [link.partition("#")[0] for link in links if "://" not in link and not link.startswith("#")]
    assert not [link for link in inside if not ((ROOT / page).parent / link).exists()]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change["what"])
def test_a_change_names_as_many_files_as_it_counts_and_its_tests(change: re.Match[str]) -> None:
    files = paths(change["files"])
    assert files
    assert not [path for path in files if path.startswith("tests/")]
    assert change["count"] in ("–", str(len(files)))
    assert paths(change["tests"]) or "`make " in change["tests"]


def test_ordinary_changes_are_on_the_page() -> None:
    assert len(CHANGES) >= 20
