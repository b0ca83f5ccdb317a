"""The wheel: every file of our packages is in it, and by itself it asks for httpx alone."""

from __future__ import annotations

import re
from pathlib import Path
from zipfile import ZipFile

import pytest
from empty_environment import build_wheel, metadata
from repository import ROOT

import canaxis

PACKAGES = ("app", "canaxis", "canaxis_command", "drivers")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("wheel"))


def test_every_file_of_the_packages_is_in_it_and_nothing_else(wheel: Path) -> None:
    ours = {
        str(file.relative_to(ROOT))
        for package in PACKAGES
        for file in (ROOT / package).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    with ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert packed == ours
    assert {Path(name).suffix for name in packed} >= {".py", ".toml", ".eds", ".typed"}


def test_the_client_alone_asks_for_httpx_alone(wheel: Path) -> None:
    declared = re.findall(r"^Requires-Dist: (.*)$", metadata(wheel), re.MULTILINE)
    assert [row for row in declared if "extra ==" not in row] == ["httpx>=0.28"]
    assert set(re.findall(r"^Provides-Extra: (.*)$", metadata(wheel), re.MULTILINE)) == {
        "build",
        "dev",
        "jog",
        "server",
    }


def test_it_has_the_version_that_the_package_tells(wheel: Path) -> None:
    assert f"\nVersion: {canaxis.__version__}\n" in metadata(wheel)
