"""Our master drives a PyPI canopen LocalNode in another process: SDO, PDO, heartbeat and EMCY."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

import drivers.devices
from drivers.bus.memory import MemoryWire
from drivers.bus.pythoncan import PythonCanBus
from drivers.cia301.objects import Address
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.errors import AxisFault
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionState
from drivers.master.network import Network
from drivers.master.plan.configuration import NetworkConfig, NodeConfig
from drivers.master.plan.requests import HomeRequest, MoveRequest, SetPositionRequest
from drivers.master.seen.status import NodeState
from drivers.sim.socketcand import SocketcandServer

pytestmark = [pytest.mark.process, pytest.mark.timeout(60)]

EDS = Path(drivers.devices.__file__).with_name("data") / "tmcm_3216.eds"
SCRIPT = Path(__file__).with_name("local_node.py")


async def until(what: Callable[[], bool], seconds: float = 15.0) -> None:
    async with asyncio.timeout(seconds):
        while not what():  # noqa: ASYNC110 - what is looked at belongs to another process
            await asyncio.sleep(0.01)


@asynccontextmanager
async def local_node(port: int) -> AsyncIterator[None]:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, str(SCRIPT), str(EDS), "interface=socketcand", "channel=can0"),
        *("host=127.0.0.1", f"port={port}"),
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    try:
        assert await process.stdout.readline() == b"ready\n"
        yield
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()
        await process.stdout.read()


@pytest.fixture
async def port() -> AsyncIterator[int]:
    server = SocketcandServer(MemoryWire(), port=0)
    await server.start()
    yield server.port
    await server.close()


@pytest.fixture
async def network(port: int) -> AsyncIterator[Network]:
    bus = PythonCanBus("socketcand", channel="can0", host="127.0.0.1", port=port)
    config = NetworkConfig(nodes=(NodeConfig(node_id=1, name="stage"),))
    async with Network(bus, config, Catalog.load()) as network:
        yield network


async def ready(network: Network) -> tuple[Axis, ...]:
    node = network.node(1)
    await until(lambda: node.state is NodeState.OPERATIONAL)
    await until(lambda: all(axis.status.state is PowerState.SWITCH_ON_DISABLED for axis in node.axes))
    return node.axes


async def test_a_local_node_is_identified_configured_and_started(network: Network, port: int) -> None:
    async with local_node(port):
        await ready(network)
        status = network.node(1).status()
        assert status.identity is not None
        assert status.identity.vendor_id == 0x286
        assert status.identity.product_code == 3216
        assert status.heartbeat_age_s is not None
        assert status.heartbeat_age_s < 1.0


async def test_three_axes_of_a_local_node_move_each_to_its_own_target(network: Network, port: int) -> None:
    async with local_node(port):
        axes = await ready(network)
        await asyncio.gather(*(axis.enable() for axis in axes))
        motions = [axis.move_to(MoveRequest(target=1000 * (axis.number + 1))) for axis in axes]
        for motion in motions:
            assert await motion.wait(10.0)
        assert [motion.state for motion in motions] == [MotionState.SUCCEEDED] * 3
        assert [axis.status.position for axis in axes] == [1000, 2000, 3000]


async def test_a_local_node_is_homed_and_disabled(network: Network, port: int) -> None:
    async with local_node(port):
        axis = (await ready(network))[2]
        await axis.enable()
        motion = axis.home(HomeRequest(method=19))
        assert await motion.wait(10.0)
        assert motion.state is MotionState.SUCCEEDED, motion.error
        assert axis.status.referenced
        await axis.disable()
        assert axis.status.state is PowerState.SWITCH_ON_DISABLED


async def test_an_emcy_of_a_local_node_fails_the_motion_with_its_meaning(network: Network, port: int) -> None:
    async with local_node(port):
        axis = (await ready(network))[1]
        await axis.enable()
        motion = axis.move_to(MoveRequest(target=666))
        assert await motion.wait(10.0)
        assert motion.state is MotionState.FAILED
        assert isinstance(motion.error, AxisFault)
        await until(lambda: [record.code for record in network.node(1).emergencies] == [0x8611])
        assert network.node(1).emergencies[0].axis == 1


async def test_a_local_node_that_dies_is_lost_and_comes_back(network: Network, port: int) -> None:
    async with local_node(port):
        axes = await ready(network)
        await axes[0].enable()
    await until(lambda: network.node(1).state is NodeState.LOST)
    async with local_node(port):
        axes = await ready(network)
        assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED, "never enabled by itself"


async def test_an_output_is_written_and_read_back_and_a_position_set(network: Network, port: int) -> None:
    async with local_node(port):
        axes = await ready(network)
        node = network.node(1)
        await node.write(Address(0x2711), 0b1111, confirm=True)
        assert (await node.terminals.switch(1, on=True)).on
        assert (await node.terminals.switch(3, on=True)).on
        assert not (await node.terminals.switch(1, on=False)).on
        held = [await node.read(Address(0x2703, sub)) for sub in (1, 2)]
        assert held == [1 << 19, 1 << 17 | 1 << 19]
        await axes[1].enable()
        motion = axes[1].set_position(SetPositionRequest(0))
        await motion.wait(20)
        assert motion.state is MotionState.SUCCEEDED, motion.error
