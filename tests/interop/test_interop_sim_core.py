"""PyPI canopen as the master of the simulated module: strings, every object, abort codes, PDOs, EMCY, LSS.

Both live in this process: the module in the test's event loop behind a socketcand server, canopen in threads.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TypeVar

import canopen
import pytest
from canopen.pdo import PdoVariable
from canopen_kit import objects

import drivers.devices
from drivers.bus.memory import MemoryWire
from drivers.cia301.objects import Address
from drivers.devices.catalog import Catalog
from drivers.sim.runner import SimulatedNode, simulated_node
from drivers.sim.socketcand import SocketcandServer

EDS = Path(drivers.devices.__file__).with_name("data") / "tmcm_3216.eds"
PROFILE = Catalog.load().profile("TMCM-3216")

Result = TypeVar("Result")

pytestmark = pytest.mark.timeout(60)


@pytest.fixture
async def wire() -> MemoryWire:
    return MemoryWire()


@pytest.fixture
async def module(wire: MemoryWire) -> AsyncIterator[SimulatedNode]:
    async with simulated_node(wire, PROFILE, serial=4711) as node:
        yield node


@pytest.fixture
async def network(wire: MemoryWire, module: SimulatedNode) -> AsyncIterator[canopen.Network]:
    server = SocketcandServer(wire, port=0)
    await server.start()
    network = canopen.Network()
    connect = lambda: network.connect(  # noqa: E731
        interface="socketcand", host="127.0.0.1", port=server.port, channel="can0"
    )
    await asyncio.to_thread(connect)
    try:
        yield network
    finally:
        await asyncio.to_thread(network.disconnect)
        await server.close()


@pytest.fixture
async def peer(network: canopen.Network) -> canopen.RemoteNode:
    node = canopen.RemoteNode(1, str(EDS))
    node.sdo.RESPONSE_TIMEOUT = 2
    network.add_node(node)
    return node


async def run(work: Callable[[], Result]) -> Result:
    return await asyncio.to_thread(work)


def number_in(mapped: PdoVariable) -> int:
    """What the PDO brought last; canopen's type for it has texts as well."""
    value = mapped.raw
    assert isinstance(value, int)
    return value


async def test_strings_and_identity(peer: canopen.RemoteNode) -> None:
    def work() -> tuple:
        return (
            objects(peer)[0x1008].raw,
            objects(peer)[0x1009].raw,
            objects(peer)[0x100A].raw,
            [objects(peer)[0x1018][sub].raw for sub in range(1, 5)],
        )

    assert await run(work) == ("TMCM-3216", "1.00", "1.04", [0x286, 3216, 0x10004, 4711])


async def test_every_object_is_read(peer: canopen.RemoteNode) -> None:
    def work() -> list:
        wrong = []
        for address, spec in PROFILE.objects.items():
            data = peer.sdo.upload(address.index, address.sub)
            if spec.type.size is not None and len(data) != spec.type.size:
                wrong.append(address)
        return wrong

    assert await run(work) == []


async def test_every_rw_object_is_written_at_its_limits_and_refused_beyond(peer: canopen.RemoteNode) -> None:
    special = range(0x1400, 0x1C00)  # rules of their own, tested below

    def refused(address: Address, data: bytes) -> int | None:
        try:
            peer.sdo.download(address.index, address.sub, data)
        except canopen.SdoAbortedError as error:
            return error.code
        return None

    def work() -> list:
        wrong = []
        for address, spec in PROFILE.objects.items():
            low, high = spec.minimum, spec.maximum
            if not spec.access.writable or address.index in special or address.index < 0x2000:
                continue
            if address.index in (0x2706,) or low is None or high is None:
                continue
            size, signed = spec.type.size, spec.type.signed
            assert size is not None, f"{address} has limits, so it is a number"
            for value, expected in ((low - 1, {0x06090032}), (high + 1, {0x06090031})):
                if not spec.type.minimum <= value <= spec.type.maximum:
                    continue
                code = refused(address, value.to_bytes(size, "little", signed=signed))
                if code not in expected:
                    wrong.append((str(address), value, hex(code or 0)))
            too_long = refused(address, bytes(size + 1) if size < 4 else bytes(size + 4))
            too_short = refused(address, bytes(size - 1)) if size > 1 else 0x06070013
            if (too_long, too_short) != (0x06070012, 0x06070013):
                wrong.append((str(address), "length", too_long, too_short))
        return wrong

    assert await run(work) == []


async def test_abort_codes(peer: canopen.RemoteNode) -> None:
    expected = {
        (0x1000, 0, bytes(4)): 0x06010002,
        (0x5000, 0, bytes(4)): 0x06020000,
        (0x1018, 9, bytes(4)): 0x06090011,
        (0x1010, 1, b"evas"): 0x08000020,
        (0x1400, 1, bytes(4)): 0x06090030,
        (0x1A00, 1, bytes(4)): 0x06010000,
    }

    def work() -> dict:
        codes = {}
        for index, sub, data in expected:
            try:
                peer.sdo.download(index, sub, data)
            except canopen.SdoAbortedError as error:
                codes[index, sub, data] = error.code
        return codes

    assert await run(work) == expected


async def test_heartbeat_and_nmt(peer: canopen.RemoteNode) -> None:
    def work() -> list[str]:
        objects(peer)[0x1017].raw = 20
        seen = []
        for state in ("OPERATIONAL", "PRE-OPERATIONAL", "STOPPED"):
            peer.nmt.state = state
            for _ in range(3):
                peer.nmt.wait_for_heartbeat(timeout=2)
            seen.append(peer.nmt.state)
        peer.nmt.state = "RESET"
        peer.nmt.wait_for_bootup(timeout=2)
        return seen

    assert await run(work) == ["OPERATIONAL", "PRE-OPERATIONAL", "STOPPED"]


@pytest.mark.parametrize("axis", [0, 1, 2])
async def test_pdos_remapped_by_canopen_carry_commands_and_status(
    peer: canopen.RemoteNode, module: SimulatedNode, axis: int
) -> None:
    offset, number = 0x800 * axis, 1 + 64 * axis

    def work() -> list[int]:
        peer.nmt.state = "PRE-OPERATIONAL"
        peer.tpdo.read()
        peer.rpdo.read()
        status, command = peer.tpdo[number], peer.rpdo[number]
        status.clear()
        status.add_variable(0x6041 + offset)
        status.add_variable(0x6061 + offset)
        status.cob_id, status.trans_type, status.enabled = 0x190 + axis, 255, True
        status.event_timer = 20
        command.clear()
        command.add_variable(0x6040 + offset)
        command.add_variable(0x6060 + offset)
        command.cob_id, command.trans_type, command.enabled = 0x210 + axis, 255, True
        status.save()
        command.save()
        peer.nmt.state = "OPERATIONAL"
        words: list[int] = []
        for word in (6, 7, 15):
            command[0].raw, command[1].raw = word, 3
            command.transmit()
            for _ in range(50):
                status.wait_for_reception(timeout=2)
                state = number_in(status[0]) & 0x6F
                if state in (0x21, 0x23, 0x27) and state not in words:
                    break
            words.append(number_in(status[0]) & 0x6F)
        return [*words, number_in(status[1])]

    assert await run(work) == [0x21, 0x23, 0x27, 3]
    assert [unit.state.value for unit in module.module.axes].count("operation_enabled") == 1


async def test_emergencies_arrive_with_their_bytes(peer: canopen.RemoteNode, module: SimulatedNode) -> None:
    arrived = threading.Event()
    peer.emcy.add_callback(lambda _error: arrived.set())
    module.apply(lambda unit, now: unit.axes[1].short("a", now))
    await run(lambda: arrived.wait(5))
    error = peer.emcy.log[0]
    assert (error.code, error.data) == (0x2312, bytes((0, 1, 0, 0, 0)))
    assert await run(lambda: objects(peer)[0x1001].raw) == error.register


async def test_saved_parameters_survive_a_power_cycle(
    peer: canopen.RemoteNode, module: SimulatedNode
) -> None:
    def write() -> None:
        objects(peer)[0x2212].raw = 1234
        peer.store()

    await run(write)
    module.power_cycle()
    assert await run(lambda: objects(peer)[0x2212].raw) == 1234


async def test_canopens_lss_master_gives_it_another_node_id(
    network: canopen.Network, module: SimulatedNode
) -> None:
    def work() -> tuple:
        lss = network.lss
        found = lss.send_switch_state_selective(0x286, 3216, 0x10004, 4711)
        before = lss.inquire_node_id()
        lss.configure_node_id(12)
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        network.nmt.send_command(0x81)
        return found, before

    assert await run(work) == (True, 1)
    renamed = canopen.RemoteNode(12, str(EDS))
    network.add_node(renamed)
    renamed.sdo.RESPONSE_TIMEOUT = 2
    assert await run(lambda: objects(renamed)[0x2708].raw) == 12
