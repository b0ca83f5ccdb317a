"""What the tests of the faults ask of a service, in the words of docs/faults.md."""

from __future__ import annotations

from typing import Any

import httpx
from api_bench import Bench

from drivers.bus.frame import Frame
from drivers.cia301.objects import Address

FAR = 10_000_000
"""Steps: a move that no test sees the end of."""
SDO_ANSWER, SDO_REQUEST, HEARTBEAT, OUR_HEARTBEAT, EMERGENCY = 0x581, 0x601, 0x701, 0x77F, 0x081


async def moving(bench: Bench) -> dict[str, Any]:
    """Axis 0 on a long way; its operation."""
    await bench.enable()
    operation = (await bench.move(FAR)).json()
    await bench.until_moving()
    return operation


async def ended(bench: Bench, operation: dict[str, Any]) -> dict[str, Any]:
    """The operation once it has ended."""
    return (await bench.get(f"/operations/{operation['id']}?wait=60")).json()


async def node_is(bench: Bench, state: str, within: float = 60.0) -> dict[str, Any]:
    """Wait until the node is in this state; what it says of itself then."""
    node = bench.service.network.node(1)
    await bench.until(lambda: node.status().state == state, within)
    return (await bench.get("/nodes/1")).json()


async def reasons(bench: Bench) -> list[str]:
    """Why the service is not ready; empty if it is."""
    ready = await bench.client.get("/readyz")
    found = ready.json()["reasons"]
    assert ready.status_code == (503 if found else 200)
    return found


async def metric(bench: Bench, name: str) -> float:
    """A measurement, by name and labels as Prometheus reads them."""
    lines = (await bench.client.get("/metrics")).text.splitlines()
    return float(next(line for line in lines if line.startswith(name + " ")).rpartition(" ")[2])


def refusal(response: httpx.Response) -> tuple[int, str]:
    """Status and code of a problem, which always says what to do."""
    problem = response.json()
    assert response.headers["content-type"] == "application/problem+json"
    assert problem["hint"]
    return response.status_code, problem["code"]


def truly_moving(bench: Bench, axis: int = 0) -> bool:
    """Whether the motor turns, whatever anybody believes."""
    return bench.module.apply(lambda module, now: module.axes[axis].moving)


def truly_state(bench: Bench, axis: int = 0) -> str:
    """The drive's state, whatever anybody believes."""
    return bench.module.apply(lambda module, now: module.axes[axis].state.value)


def place(bench: Bench, axis: int = 0) -> float:
    """Where the carriage is, whatever anybody believes."""
    return bench.module.apply(lambda module, now: module.axes[axis].motor.place(now))


class Written:
    """The SDO writes that reach the wire from now on, as addresses."""

    def __init__(self, bench: Bench) -> None:
        self.addresses: list[Address] = []
        bench.wire.tap(self._note)

    def _note(self, sender: str, frame: Frame) -> None:
        if frame.cob_id == SDO_REQUEST and frame.data[0] >> 5 == 1:
            self.addresses.append(Address(int.from_bytes(frame.data[1:3], "little"), frame.data[3]))


def sent_to(bench: Bench, *cob_ids: int) -> list[Frame]:
    """The frames with these identifiers that cross the wire from now on; the list grows."""
    frames: list[Frame] = []
    bench.wire.tap(lambda sender, frame: frames.append(frame) if frame.cob_id in cob_ids else None)
    return frames
