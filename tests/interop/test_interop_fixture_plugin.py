"""The shipped fixtures as their users have them: PyPI canopen as the master, the service with its client."""

from __future__ import annotations

import queue
from collections.abc import Iterator, Mapping
from dataclasses import fields
from importlib.resources import files

import canopen
import pytest
from canopen.emcy import EmcyError
from canopen_kit import objects

from canaxis import BadValue, Client, NotFound, UnknownNode
from canaxis.testing import (
    AxisState,
    ModuleState,
    NotStarted,
    RunningService,
    SimulatedPort,
    WatchState,
    WireFault,
    simulate,
)
from drivers.sim import snapshot

pytestmark = pytest.mark.process

pytest_plugins = ["canaxis.testing"]

EDS = str(files("drivers.devices").joinpath("data", "tmcm_3216.eds"))


@pytest.fixture(scope="module")
def port() -> Iterator[SimulatedPort]:
    """One process for all who can share it, as the page says."""
    with simulate() as port:
        yield port


def joined(port: SimulatedPort) -> canopen.Network:
    network = canopen.Network()
    network.connect(interface="socketcand", host=port.host, port=port.port, channel=port.channel)
    return network


@pytest.fixture
def network(port: SimulatedPort) -> Iterator[canopen.Network]:
    network = joined(port)
    yield network
    network.disconnect()


def remote(network: canopen.Network, node_id: int) -> canopen.RemoteNode:
    node = network.add_node(node_id, EDS)
    node.sdo.RESPONSE_TIMEOUT = 2
    return node


def test_canopen_drives_an_axis_of_it(port: SimulatedPort, network: canopen.Network) -> None:
    sdo = objects(remote(network, 1))
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
    axis = port.panel(1).state().axes[0]
    assert (axis.state, axis.mode, axis.moving) == ("operation_enabled", "pv", True)


def test_what_the_panel_does_canopen_sees(port: SimulatedPort, network: canopen.Network) -> None:
    node = remote(network, 1)
    panel = port.panel(1)
    received: queue.Queue[EmcyError] = queue.Queue()
    node.emcy.add_callback(received.put)  # `wait` would miss what came before it was called
    assert panel.perform("set_temperature", axis=2, celsius=130).axes[2].temperature == 130
    emergency = received.get(timeout=5)
    assert emergency.code == 0x4310
    assert emergency.data[1] == 2
    panel.perform("press_switch", axis=1, switch="negative")
    assert objects(node)[0x68FD].raw & 1
    panel.perform("set_sdo_mute", active=True)
    node.sdo.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(canopen.SdoCommunicationError):
        node.sdo.upload(0x1000, 0)
    assert not panel.clear().sdo_mute
    node.sdo.RESPONSE_TIMEOUT = 2
    assert node.sdo.upload(0x1000, 0) == bytes.fromhex("9201fcff")


def test_what_can_not_be_done_is_told_as_the_client_does(port: SimulatedPort) -> None:
    panel = port.panel()
    with pytest.raises(NotFound, match=r"no command 'explode'.*press_switch"):
        panel.perform("explode")
    with pytest.raises(BadValue, match="one of negative, positive, home"):
        panel.perform("press_switch", axis=0, switch="left")
    with pytest.raises(UnknownNode, match="node ID 4"):
        port.panel(4).state()
    assert panel.perform("drop_frames", cob_id=0x701, count=3).wire_faults == (
        WireFault("drop", 0x701, 0, 3),
    )
    assert panel.clear().wire_faults == ()


@pytest.mark.parametrize("simulated_nodes", [(3, 4)])
def test_several_modules_and_what_happens_to_them(simulated_port: SimulatedPort) -> None:
    network = joined(simulated_port)
    try:
        third, fourth = remote(network, 3), remote(network, 4)
        assert [objects(node)[0x1018][4].raw for node in (third, fourth)] == [3, 4]
        assert not simulated_port.panel(4).perform("power_off").powered
        fourth.sdo.RESPONSE_TIMEOUT = 0.1
        with pytest.raises(canopen.SdoCommunicationError):
            fourth.sdo.upload(0x1000, 0)
        assert objects(third)[0x1000].raw == 0xFFFC0192
        assert simulated_port.panel(3).state().powered
    finally:
        network.disconnect()


class TestService:
    @pytest.fixture
    def canaxis_settings(self) -> Mapping[str, object]:
        axes = [{"name": "x", "unit": "mm", "pitch": "4 mm"}]
        return {"nodes": [{"id": 1, "name": "table", "axes": axes}]}

    def test_a_service_moves_what_the_panel_sees(
        self, canaxis_service: RunningService, simulated_port: SimulatedPort
    ) -> None:
        axis = canaxis_service.client.node("table").axis("x")
        axis.enable()
        axis.move(0.5, "mm").wait(timeout=30)
        assert simulated_port.panel(1).state().axes[0].position == 51_200 * 0.5 / 4
        with Client(canaxis_service.url) as another:
            position = another.node(1).axis(0).status().position
            assert position is not None
            assert position.value == 0.5
        assert "Canaxis listens on" in canaxis_service.output


def test_what_does_not_start_says_why() -> None:
    told = "canaxis simulate ended: canaxis: --model TMCM-1: known are TMCM-3216"
    with pytest.raises(NotStarted, match=told), simulate(model="TMCM-1"):
        pytest.fail("there is no such model")


@pytest.mark.parametrize(
    ("ours", "simulators"),
    [
        (ModuleState, snapshot.ModuleSnapshot),
        (AxisState, snapshot.AxisSnapshot),
        (WatchState, snapshot.WatchSnapshot),
        (WireFault, snapshot.WireFaultSnapshot),
    ],
)
def test_a_state_has_every_field_of_the_simulators(ours: type, simulators: type) -> None:
    assert [field.name for field in fields(ours)] == [field.name for field in fields(simulators)]
