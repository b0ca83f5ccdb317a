"""Nodes on the wire: what they are, how they are, what they reported, and their objects."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply, Request, Scalar


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


class ChangeReply(Reply):
    """An object that held something else than it should, and was written."""

    index: str = Field(description="Object index, hexadecimal.")
    sub: int
    name: str
    axis: int | None = Field(description="None: the object is the node's.")
    old: int | None = Field(description="In `unit`; None if it could not be read.")
    new: int = Field(description="In `unit`; written and read back.")
    unit: str = Field(description="Empty for a plain number.")


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


class NodeReply(Reply):
    """One module."""

    model_config = examples.shown(examples.NODE)

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

    model_config = examples.shown({"nodes": [examples.NODE]})

    nodes: list[NodeReply]


class EmergencyReply(Reply):
    """One emergency that a node reported, with its meaning."""

    model_config = examples.shown(examples.EMERGENCY)

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

    model_config = examples.shown({"emergencies": [examples.EMERGENCY]})

    emergencies: list[EmergencyReply]


class MeaningReply(Reply):
    """What a set bit, or the value, says."""

    name: str
    title: str
    cause: str
    remedy: str


class ObjectReply(Reply):
    """The value of one object; bytes are shown in hexadecimal."""

    model_config = examples.shown(examples.OBJECT)

    node: int
    index: str
    sub: int
    name: str
    type: str
    access: str
    unit: str
    value: int | float | str | bool
    meanings: list[MeaningReply] = Field(
        description="For flags: each bit that is set. For option codes: the value."
    )


class ObjectBody(Request):
    """A value to write past the axis."""

    model_config = examples.shown(examples.OBJECT_WRITE)

    value: Scalar
    confirm: bool = Field(default=False, description="Needed for objects that could endanger motion.")
