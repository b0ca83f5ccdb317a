"""The shipped fixtures as their users have them: PyPI canopen as the master on `simulated_port`."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from importlib.resources import files

import canopen
import pytest

from drivers.errors import BadValue, BusError, UnknownNode
from drivers.sim.background import BackgroundStation
from drivers.sim.panel import COMMANDS
from drivers.sim.station import Listen, Station

pytest_plugins = ["drivers.sim.fixtures"]

EDS = str(files("drivers.devices").joinpath("data", "tmcm_3216.eds"))


@pytest.fixture
def network(simulated_port: BackgroundStation) -> Iterator[canopen.Network]:
    network = canopen.Network()
    network.connect(
        interface="socketcand",
        host=simulated_port.host,
        port=simulated_port.port,
        channel=simulated_port.channel,
    )
    yield network
    network.disconnect()


def remote(network: canopen.Network, node_id: int) -> canopen.RemoteNode:
    node = network.add_node(node_id, EDS)
    node.sdo.RESPONSE_TIMEOUT = 2
    return node


def test_canopen_drives_an_axis_of_it(simulated_port: BackgroundStation, network: canopen.Network) -> None:
    sdo = remote(network, 1).sdo
    assert sdo["Manufacturer Device Name"].raw == "TMCM-3216"
    for index, value in (
        (0x6060, 3),
        (0x6083, 100_000),
        (0x6040, 6),
        (0x6040, 7),
        (0x6040, 15),
        (0x60FF, 5000),
    ):
        sdo[index].raw = value
    axis = simulated_port.panel(1).state().axes[0]
    assert (axis.state, axis.mode, axis.moving) == ("operation_enabled", "pv", True)


def test_what_the_panel_does_canopen_sees(
    simulated_port: BackgroundStation, network: canopen.Network
) -> None:
    node = remote(network, 1)
    panel = simulated_port.panel(1)
    received: queue.Queue[canopen.emcy.EmcyError] = queue.Queue()
    node.emcy.add_callback(received.put)  # `wait` would miss what came before it was called
    panel.perform("set_temperature", axis=2, celsius=130)
    emergency = received.get(timeout=5)
    assert emergency.code == 0x4310
    assert emergency.data[1] == 2
    panel.perform("press_switch", axis=1, switch="negative")
    assert node.sdo[0x68FD].raw & 1
    panel.perform("set_sdo_mute", active=True)
    node.sdo.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(canopen.SdoCommunicationError):
        node.sdo.upload(0x1000, 0)
    panel.clear()
    node.sdo.RESPONSE_TIMEOUT = 2
    assert node.sdo.upload(0x1000, 0) == bytes.fromhex("9201fcff")


@pytest.mark.parametrize("simulated_nodes", [(3, 4)])
def test_several_modules_and_what_happens_to_them(
    simulated_port: BackgroundStation,
    network: canopen.Network,
) -> None:
    third, fourth = remote(network, 3), remote(network, 4)
    assert [node.sdo[0x1018][4].raw for node in (third, fourth)] == [3, 4]
    simulated_port.run(lambda station: station.remove(4))
    fourth.sdo.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(canopen.SdoCommunicationError):
        fourth.sdo.upload(0x1000, 0)
    assert third.sdo[0x1000].raw == 0xFFFC0192
    with pytest.raises(UnknownNode, match="node ID 4"):
        simulated_port.panel(4).state()


def test_calls_run_in_the_modules_own_thread(simulated_port: BackgroundStation) -> None:
    there = simulated_port.call(lambda station: (threading.current_thread().name, list(station.nodes)))
    assert there == ("simulated modules", [1])
    assert simulated_port.panel().commands == tuple(COMMANDS)
    with pytest.raises(BadValue, match="no command 'explode'"):
        simulated_port.panel().perform("explode")


async def test_the_memory_wire_serves_asyncio_tests(simulated_module) -> None:
    async with simulated_module((1, 2)) as station:
        assert [panel.state().nmt_state for panel in station.panels.values()] == ["pre_operational"] * 2


def test_a_station_that_can_not_start_says_why_and_leaves_no_thread() -> None:
    before = threading.active_count()
    with BackgroundStation() as first:

        def taken(_: Listen) -> Station:
            return Station(listen=Listen(port=first.port))

        with pytest.raises(BusError, match="can't listen on"), BackgroundStation(taken):
            pytest.fail("two servers on one port")
    assert threading.active_count() == before
