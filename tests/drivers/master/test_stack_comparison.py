"""A live node held against its profile: what agrees, what differs, and that nothing is ever written."""

from __future__ import annotations

import dataclasses
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager

import pytest

from drivers.bus.memory import MemoryBus, MemoryWire
from drivers.cia301.objects import Address
from drivers.cia301.types import DataType
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile, Identity, ObjectSpec
from drivers.errors import NodeAway, WrongIdentity
from drivers.master.comparison import Comparison, DifferenceKind, compare
from drivers.sim.station import Station

pytestmark = pytest.mark.looptime

CATALOG = Catalog.load()
PROFILE = CATALOG.profile("TMCM-3216")


@asynccontextmanager
async def bench(profile: DeviceProfile = PROFILE, node: int = 1) -> AsyncIterator[tuple[Station, MemoryBus]]:
    async with Station((node,), profile, wire=MemoryWire()) as station:
        port = station.wire.port("check")
        await port.open()
        yield station, port
        await port.close()


async def compared(profile: DeviceProfile, node: int = 1) -> Comparison:
    async with bench(profile, node) as (_, port):
        return await compare(port, node, CATALOG, model="TMCM-3216")


def altered(changes: Mapping[Address, Callable[[ObjectSpec], ObjectSpec] | None]) -> DeviceProfile:
    """A module that is not quite as its manual says; None = it lacks the object."""
    objects = dict(PROFILE.objects)
    for address, change in changes.items():
        if change is None:
            del objects[address]
        else:
            objects[address] = change(objects[address])
    return dataclasses.replace(PROFILE, objects=objects)


def found(outcome: Comparison) -> list[tuple[str, DifferenceKind]]:
    return [(str(one.address), one.kind) for one in outcome.differences]


@pytest.mark.parametrize(("node", "settings"), [(1, []), (42, ["2705h:0"])])
async def test_a_module_agrees_with_its_own_profile_whatever_its_node_id(
    node: int, settings: list[str]
) -> None:
    async with bench(node=node) as (_, port):
        outcome = await compare(port, node, CATALOG)
    assert outcome.agrees
    assert outcome.differences == ()
    assert [str(one.address) for one in outcome.settings] == settings
    assert (outcome.model, outcome.checked, outcome.foreign) == ("TMCM-3216", len(PROFILE.objects), 0)


async def test_it_only_reads() -> None:
    async with bench() as (station, port):
        heard: list[tuple[int, int]] = []
        end = station.wire.tap(
            lambda sender, f: heard.append((f.cob_id, f.data[0])) if sender == "check" else None
        )
        await compare(port, 1, CATALOG)
        end()
    assert {cob_id for cob_id, _ in heard} == {0x601}
    assert {command >> 5 for _, command in heard} == {2, 3}, "upload requests and segments of them, no more"


async def test_what_is_missing_is_reported() -> None:
    profile = altered({Address(0x210A): None, Address(0x1018, 3): None, Address(0x7064): None})
    assert found(await compared(profile)) == [
        ("1018h:3", DifferenceKind.MISSING),
        ("210Ah:0", DifferenceKind.MISSING),
        ("7064h:0", DifferenceKind.MISSING),
    ]


async def test_another_length_is_another_type() -> None:
    wide = altered(
        {Address(0x2005): lambda spec: dataclasses.replace(spec, type=DataType.UNSIGNED8, default=0)}
    )
    outcome = await compared(wide)
    assert found(outcome) == [("2005h:0", DifferenceKind.LENGTH)]
    (one,) = outcome.differences
    assert (one.expected, one.found) == ("4 bytes (U32)", "1 byte (00)")


async def test_another_identity_or_number_of_entries_is_reported() -> None:
    other = altered(
        {
            Address(0x1008): lambda spec: dataclasses.replace(spec, default="TMCM-9999"),
            Address(0x1010): lambda spec: dataclasses.replace(spec, default=7),
            Address(0x6502): lambda spec: dataclasses.replace(spec, default=1),
        }
    )
    outcome = await compared(other)
    assert [(str(one.address), one.expected, one.found) for one in outcome.differences] == [
        ("1008h:0", "'TMCM-3216'", "'TMCM-9999'"),
        ("1010h:0", "6", "7"),
        ("6502h:0", "421", "1"),
    ]
    assert {one.kind for one in outcome.differences} == {DifferenceKind.CONSTANT}


async def test_a_value_that_there_is_not_is_reported() -> None:
    wild = altered(
        {Address(0x2000): lambda spec: dataclasses.replace(spec, allowed=None, high=None, default=200)}
    )
    assert found(await compared(wild)) == [
        ("2000h:0", DifferenceKind.RANGE),
        ("2107h:0", DifferenceKind.RANGE),  # which displays the former
    ]


async def test_what_someone_set_is_told_but_no_difference() -> None:
    async with bench() as (station, port):
        station.node(1).module.dictionary.load({Address(0x2005): 3})
        outcome = await compare(port, 1, CATALOG)
    assert outcome.agrees
    assert [(str(one.address), one.expected, one.found) for one in outcome.settings] == [
        ("2005h:0", "0", "3")
    ]


async def test_a_node_that_is_not_there_is_no_difference() -> None:
    async with bench() as (_, port):
        with pytest.raises(NodeAway, match="node 9 does not answer"):
            await compare(port, 9, CATALOG)


async def test_a_node_that_falls_silent_ends_the_comparison() -> None:
    async with bench() as (station, port):

        def fall_silent(done: int, total: int) -> None:
            assert total == len(PROFILE.objects)
            if done == 20:
                station.panel(1).set_silent(True)

        with pytest.raises(NodeAway):
            await compare(port, 1, CATALOG, progress=fall_silent)


async def test_one_lost_answer_is_made_up_for() -> None:
    async with bench() as (station, port):
        station.panel(1).drop_frames(0x581, count=1)
        assert (await compare(port, 1, CATALOG)).agrees


async def test_a_stranger_is_named() -> None:
    stranger = dataclasses.replace(
        PROFILE, identity=Identity("X", 0x999, 1, 0, PROFILE.device_type, PROFILE.identity.device_name)
    )
    async with bench(stranger) as (_, port):
        with pytest.raises(WrongIdentity, match="vendor 999h and product 1h") as unknown:
            await compare(port, 1, CATALOG)
    assert "TMCM-3216" in unknown.value.hint


async def test_another_master_on_the_same_node_is_noticed() -> None:
    async with bench() as (station, port):
        station.panel(1).duplicate_frames(0x581, count=5)
        outcome = await compare(port, 1, CATALOG)
    assert outcome.agrees
    assert outcome.foreign == 5
