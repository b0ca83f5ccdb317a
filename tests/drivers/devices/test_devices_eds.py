"""The EDS: the committed file is what the data makes, and PyPI canopen reads the same objects from it."""

from __future__ import annotations

import io
import re
from importlib.resources import files

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

from drivers.devices.eds import build_eds, file_name
from drivers.devices.profile import DeviceProfile, ObjectKind

NODE_ID = 5


@pytest.fixture(scope="module")
def text(tmcm_3216: DeviceProfile) -> str:
    return build_eds(tmcm_3216)


@pytest.fixture(scope="module")
def dictionary(text: str) -> canopen.ObjectDictionary:
    return import_eds(io.StringIO(text), NODE_ID)


def test_the_committed_file_is_up_to_date(tmcm_3216: DeviceProfile, text: str) -> None:
    committed = files("drivers.devices").joinpath("data", file_name(tmcm_3216)).read_text(encoding="ascii")
    assert committed == text, "run: make eds"


def test_the_committed_file_opens_by_its_path(tmcm_3216: DeviceProfile) -> None:
    path = files("drivers.devices").joinpath("data", file_name(tmcm_3216))
    assert canopen.import_od(str(path), NODE_ID)[0x6040].name == "Controlword (axis 0)"


def test_canopen_finds_each_object_as_the_profile_has_it(
    tmcm_3216: DeviceProfile, dictionary: canopen.ObjectDictionary
) -> None:
    for address, spec in tmcm_3216.objects.items():
        entry = dictionary[address.index]
        assert isinstance(entry, ODVariable) is (spec.kind is ObjectKind.VAR), address
        variable = entry if isinstance(entry, ODVariable) else entry[address.sub]
        assert variable.data_type == spec.type
        assert variable.access_type == spec.access
        assert variable.pdo_mappable == spec.mappable
        assert (variable.min, variable.max) == (spec.low, spec.high)
        assert variable.default == spec.default_for(NODE_ID), address
        assert variable.relative == spec.node_relative


def test_canopen_finds_no_other_objects(
    tmcm_3216: DeviceProfile, dictionary: canopen.ObjectDictionary
) -> None:
    assert set(dictionary) == {address.index for address in tmcm_3216.objects}


def test_the_device_is_described(dictionary: canopen.ObjectDictionary) -> None:
    info = dictionary.device_information
    assert (info.vendor_number, info.product_number, info.product_name) == (0x286, 3216, "TMCM-3216")
    assert (info.nr_of_RXPDO, info.nr_of_TXPDO) == (12, 12)
    assert info.LSS_supported
    assert not info.simple_boot_up_master
    assert info.allowed_baudrates == {rate * 1000 for rate in (20, 50, 125, 250, 500, 800, 1000)}


def test_the_lists_name_each_object_once(tmcm_3216: DeviceProfile, text: str) -> None:
    listed: list[int] = []
    for title in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        body = text.split(f"[{title}]\n")[1].split("\n\n")[0]
        members = [int(index, 16) for index in re.findall(r"^\d+=0x(\w+)$", body, re.MULTILINE)]
        assert f"SupportedObjects={len(members)}" in body
        assert members == sorted(members)
        listed += members
    assert sorted(listed) == sorted({address.index for address in tmcm_3216.objects})


def test_a_record_counts_its_sub_indices(text: str) -> None:
    assert "[1018]\nSubNumber=5\n" in text
    assert "[1A40]\nSubNumber=4\nParameterName=Transmit PDO 65 Mapping Parameter\n" in text


def test_the_header_says_where_it_comes_from_and_that_nothing_is_verified(text: str) -> None:
    header = text.split("[FileInfo]")[0]
    assert "firmware V1.04" in header
    assert "drivers/devices/data" in header
    assert "verified on hardware" in header


def test_what_is_unverified_stands_above_its_object(text: str) -> None:
    above = text.split("[2707]")[0].rsplit("\n\n", 1)[1]
    assert above.startswith("; 2707h:0, manual section 4.2.65: Printed as UNSIGNED8")


def test_no_two_objects_share_a_name(dictionary: canopen.ObjectDictionary) -> None:
    names = [entry.name for entry in dictionary.values()]
    assert len(names) == len(set(names))
