"""The page on the object dictionary names whatever the data marks as unverified on hardware."""

from __future__ import annotations

import re

from repository import ROOT

from drivers.devices.profile import DeviceProfile, Scope

PAGE = ROOT / "docs" / "module" / "object-dictionary.md"


def test_every_unverified_object_is_on_the_page(tmcm_3216: DeviceProfile) -> None:
    page = PAGE.read_text(encoding="utf-8")
    unverified = {
        spec.base_index & ~3 if spec.scope is Scope.PDO else spec.base_index
        for spec in tmcm_3216.objects.values()
        if "nverified on hardware" in spec.note
    }
    assert {index for index in unverified if f"{index:04X}h" not in page} == set()


def test_every_file_of_the_data_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    folder = PAGE.parents[2] / "drivers" / "devices" / "data" / "tmcm_3216"
    assert set(re.findall(r"`(\w+\.toml)`", page)) == {file.name for file in folder.iterdir()}
