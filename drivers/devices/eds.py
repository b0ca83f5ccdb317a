"""The electronic data sheet (CiA 306) of a module, made from its profile.

``python -m drivers.devices.eds`` writes the committed file of every module anew.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from drivers.cia301.types import DataType
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile, ObjectKind, ObjectSpec, Scope

_OBJECT_TYPES = {ObjectKind.VAR: 0x7, ObjectKind.ARRAY: 0x8, ObjectKind.RECORD: 0x9}
_MANDATORY = frozenset((0x1000, 0x1001, 0x1018))
# The bit rates that CiA 306 has a key for; 100 kbit/s has none.
_BAUD_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
_RPDO_RECORDS = range(0x1400, 0x1600)
_TPDO_RECORDS = range(0x1800, 0x1A00)
_WIDTH = 110


def build_eds(profile: DeviceProfile) -> str:
    """The EDS as text: ASCII, and the same for the same profile.

    A COB-ID that depends on the node ID stands there as ``$NODEID+...``. What is unverified on hardware is a
    comment above the object of axis 0.
    """
    sections = (*_head(profile), *_object_lists(profile), *_objects(profile))
    text = "\n".join(("\n".join(_banner(profile)), *sections))
    if not text.isascii():
        raise ValueError("an EDS is ASCII, and a name or note in the data is not")
    return text


def file_name(profile: DeviceProfile) -> str:
    """What the EDS of a module is called: ``tmcm_3216.eds``."""
    return f"{profile.model.lower().replace('-', '_')}.eds"


def _banner(profile: DeviceProfile) -> Iterator[str]:
    yield from _comment(
        f"{profile.model}: electronic data sheet, made from the object dictionary of the Canaxis project by"
        " drivers/devices/eds.py. Do not edit: change drivers/devices/data and make it anew."
    )
    yield from _comment(f"Source of the data: {profile.manual}. It is not a file of the module's maker.")
    yield from _comment(
        "Nothing in it has been verified on hardware. Where the manual is wrong or silent the choice that was"
        " made stands as a comment above the object of axis 0 and holds for all axes."
    )
    yield ""


def _head(profile: DeviceProfile) -> Iterator[str]:
    year, month, day = profile.edited.split("-")
    made = {"Time": "12:00AM", "Date": f"{month}-{day}-{year}"}
    yield _section(
        "FileInfo",
        {
            "FileName": file_name(profile),
            "FileVersion": 1,
            "FileRevision": 0,
            "EDSVersion": "4.0",
            "Description": f"{profile.model}, from its manual, unverified on hardware",
            **{f"Creation{key}": value for key, value in made.items()},
            "CreatedBy": "Canaxis",
            **{f"Modification{key}": value for key, value in made.items()},
            "ModifiedBy": "Canaxis",
        },
    )
    identity = profile.identity
    yield _section(
        "DeviceInfo",
        {
            "VendorName": identity.vendor_name,
            "VendorNumber": _hex(identity.vendor_id),
            "ProductName": profile.model,
            "ProductNumber": _hex(identity.product_code),
            "RevisionNumber": _hex(identity.revision_number),
            "OrderCode": profile.model,
            **{f"BaudRate_{rate}": int(rate in profile.bit_rates) for rate in _BAUD_RATES},
            "SimpleBootUpMaster": 0,
            "SimpleBootUpSlave": 1,
            "Granularity": 8,
            "DynamicChannelsSupported": 0,
            "GroupMessaging": 0,
            "NrOfRXPDO": _count(profile, _RPDO_RECORDS),
            "NrOfTXPDO": _count(profile, _TPDO_RECORDS),
            "LSS_Supported": int("lss" in profile.features),
            "CompactPDO": 0,
        },
    )
    yield _section("DummyUsage", {f"Dummy{number:04X}": 0 for number in range(1, 8)})
    lines = (
        f"Made from {profile.manual}.",
        "Not verified on hardware; the choices made stand as comments above the objects.",
    )
    yield _section(
        "Comments", {"Lines": len(lines), **{f"Line{n}": line for n, line in enumerate(lines, start=1)}}
    )


def _object_lists(profile: DeviceProfile) -> Iterator[str]:
    indices = sorted({address.index for address in profile.objects})
    mandatory = [index for index in indices if index in _MANDATORY]
    manufacturer = [index for index in indices if 0x2000 <= index < 0x6000]
    optional = [index for index in indices if index not in _MANDATORY and index not in set(manufacturer)]
    for title, members in (
        ("MandatoryObjects", mandatory),
        ("OptionalObjects", optional),
        ("ManufacturerObjects", manufacturer),
    ):
        numbered = {str(number): f"0x{index:04X}" for number, index in enumerate(members, start=1)}
        yield _section(title, {"SupportedObjects": len(members), **numbered})


def _objects(profile: DeviceProfile) -> Iterator[str]:
    counts = Counter(address.index for address in profile.objects)
    remarked: set[tuple[int, str]] = set()
    for spec in profile.objects.values():
        # PDO records have their number in their name already.
        place = f" (axis {spec.axis})" if profile.axes > 1 and spec.scope is Scope.AXIS else ""
        if spec.kind is ObjectKind.VAR:
            yield _section(f"{spec.index:04X}", _entry(spec, f"{spec.name}{place}"), _remarks(spec))
            continue
        if spec.sub == 0:
            head = {
                "SubNumber": counts[spec.index],
                "ParameterName": f"{spec.object_name}{place}",
                "ObjectType": _hex(_OBJECT_TYPES[spec.kind]),
            }
            yield _section(f"{spec.index:04X}", head)
        remarks = () if (spec.index, spec.note) in remarked else _remarks(spec)
        remarked.add((spec.index, spec.note))
        yield _section(f"{spec.index:04X}sub{spec.sub:X}", _entry(spec, spec.name), remarks)


def _entry(spec: ObjectSpec, name: str) -> Mapping[str, object]:
    entry: dict[str, object] = {
        "ParameterName": name,
        "ObjectType": _hex(_OBJECT_TYPES[ObjectKind.VAR]),
        "DataType": f"0x{spec.type:04X}",
        "AccessType": str(spec.access),
    }
    if spec.low is not None:
        entry["LowLimit"] = _number(spec.low, spec.type)
    if spec.high is not None:
        entry["HighLimit"] = _number(spec.high, spec.type)
    if isinstance(spec.default, int):
        number = _number(spec.default, spec.type)
        entry["DefaultValue"] = f"$NODEID+{number}" if spec.node_relative else number
    elif spec.default is not None:
        entry["DefaultValue"] = spec.default
    entry["PDOMapping"] = int(spec.mappable)
    return entry


def _remarks(spec: ObjectSpec) -> tuple[str, ...]:
    """Comment lines: what can be said of an entry once, above that of axis 0."""
    if not spec.note or spec.axis:
        return ()
    return tuple(_comment(f"{spec.address}, manual §{spec.section}: {spec.note}"))


def _comment(text: str) -> Iterable[str]:
    ascii_text = text.replace("§", "section ")
    return textwrap.wrap(ascii_text, _WIDTH, initial_indent="; ", subsequent_indent=";   ")


def _section(title: str, content: Mapping[str, object], remarks: Iterable[str] = ()) -> str:
    return "\n".join((*remarks, f"[{title}]", *(f"{key}={value}" for key, value in content.items()), ""))


def _number(value: int, data_type: DataType) -> str:
    return str(value) if data_type.signed else _hex(value)


def _hex(value: int) -> str:
    return f"0x{value:X}"


def _count(profile: DeviceProfile, records: range) -> int:
    return sum(address.sub == 0 and address.index in records for address in profile.objects)


def main() -> None:
    """Write the EDS of every module beside its data."""
    folder = Path(__file__).parent / "data"
    for profile in Catalog.load().profiles:
        folder.joinpath(file_name(profile)).write_text(build_eds(profile), encoding="ascii", newline="\n")


if __name__ == "__main__":
    main()
