"""Nodes on the wire: what they are, how they are, and what they reported."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import Field

from app.axes.schemas import ChangeReply
from app.http import examples
from app.http.schemas import Reply


class IdentityReply(Reply):
    """What the module says it is (1000h, 1018h)."""

    device_type: str
    vendor_id: str
    product_code: str
    revision: int | None
    serial: int | None


class AxisName(Reply):
    """An axis of a node, by number and name."""

    axis: int
    name: str
    unit: str
    path: str


class BootStepReply(Reply):
    """One step of a boot-up."""

    name: str = Field(description="identity, axes, heartbeats, parameters, pdos, start, status")
    state: str = Field(description="pending, running, done, failed, skipped")
    compared: int = Field(description="Objects held against what they should be.")
    written: int = Field(description="Objects that differed, were written, and read back.")
    changes: list[ChangeReply] = Field(description="The first 64 of those.")
    note: str = Field(description="What was found.")
    reason: str = Field(description="Why it failed.")
    remedy: str = Field(description="What to do about that.")
    took_s: float | None = Field(description="Seconds; None until it has ended.")


class BootReply(Reply):
    """The node's last boot-up (CiA 302): compared first, only the differences written."""

    complete: bool = Field(description="Whether every step was done or had nothing to do.")
    took_s: float = Field(description="Seconds that the steps took so far.")
    steps: list[BootStepReply]


_NODE: examples.Example = {
    "node": 1,
    "name": "stage",
    "model": "TMCM-3216",
    "state": "operational",
    "reason": "",
    "nmt_state": "operational",
    "identity": {
        "device_type": "0xFFFC0192",
        "vendor_id": "0x00000286",
        "product_code": "0x00000C90",
        "revision": 1,
        "serial": 1,
    },
    "device_name": "TMCM-3216",
    "hardware_version": "1.0",
    "software_version": "1.04",
    "serial": 1,
    "failsafe": "unverified",
    "heartbeat_age_s": 0.1,
    "boot": {
        "complete": True,
        "took_s": 0.21,
        "steps": [
            {
                "name": "heartbeats",
                "state": "done",
                "compared": 3,
                "written": 1,
                "changes": [
                    {
                        "index": "0x1017",
                        "sub": 0,
                        "name": "Producer heartbeat time",
                        "axis": None,
                        "old": 0,
                        "new": 500,
                        "unit": "ms",
                    }
                ],
                "note": "Fail-safe: unverified.",
                "reason": "",
                "remedy": "",
                "took_s": 0.004,
            }
        ],
    },
    "axes": [{"axis": 0, "name": "x", "unit": "steps", "path": "/api/v1/nodes/1/axes/0"}],
    "counters": {"heartbeats": 12},
}


class NodeReply(Reply):
    """One module."""

    model_config = examples.shown(_NODE)

    node: int = Field(description="Node ID.")
    name: str
    model: str
    state: str = Field(
        description="absent, booted, identified, configured, operational, lost, refused, duplicate"
    )
    reason: str = Field(description="Why it is in this state; empty when all is well.")
    nmt_state: str | None = Field(description="As its last heartbeat or its status PDOs said.")
    identity: IdentityReply | None
    device_name: str
    hardware_version: str
    software_version: str
    serial: int | None
    failsafe: str = Field(description="Whether it stops its motors without us: verified, unverified or off.")
    heartbeat_age_s: float | None
    boot: BootReply
    axes: list[AxisName]
    counters: dict[str, Any]


class NodeList(Reply):
    """All configured nodes."""

    model_config = examples.shown({"nodes": [_NODE]})

    nodes: list[NodeReply]


_EMERGENCY: examples.Example = {
    "id": 1,
    "time": examples.TIME,
    "node": 1,
    "axis": None,
    "code": "0x8130",
    "register": "0x11",
    "data": "00 00 00 00 00",
    "title": "Heartbeat lost",
    "cause": "The module did not hear the master in time.",
    "remedy": "Check the cable and that the service runs, then reset the fault.",
    "severity": "fault",
    "active": True,
}


class EmergencyReply(Reply):
    """One emergency that a node reported, with its meaning."""

    model_config = examples.shown(_EMERGENCY)

    id: int = Field(description="Counts up per node.")
    time: datetime
    node: int
    axis: int | None = Field(description="None: the module as a whole.")
    code: str = Field(description="Hexadecimal.", examples=["0x8130"])
    register_: str = Field(serialization_alias="register", description="Error register 1001h, hexadecimal.")
    data: str = Field(description="The five bytes behind, hexadecimal.")
    title: str
    cause: str
    remedy: str
    severity: str
    active: bool


class EmergencyList(Reply):
    """A node's emergencies, the newest first."""

    model_config = examples.shown({"emergencies": [_EMERGENCY]})

    emergencies: list[EmergencyReply]
