"""The async shell: a network of nodes, each supervised by itself, each axis in charge of what it does."""

from __future__ import annotations

from drivers.devices.profile import ObjectSpec
from drivers.master.axis.axis import Axis
from drivers.master.axis.commands import AxisCommand
from drivers.master.ground.timing import Timing
from drivers.master.motions.jogging import Jog, JogEnd
from drivers.master.motions.motion import Motion, MotionCancelled, MotionKind, MotionState, Operation
from drivers.master.network import Network
from drivers.master.node.node import Node
from drivers.master.plan.configuration import AxisConfig, NetworkConfig, NodeConfig
from drivers.master.plan.requests import (
    HomeRequest,
    JogRequest,
    MoveRequest,
    SetPositionRequest,
    VelocityRequest,
)
from drivers.master.sdo.client import Priority
from drivers.master.seen.emergencies import EmergencyRecord
from drivers.master.seen.events import Event, EventHub, Subscription
from drivers.master.seen.status import (
    Adoption,
    AxisStatus,
    BusStatus,
    Failsafe,
    Identity,
    NodeState,
    NodeStatus,
    Reference,
    Switches,
)
from drivers.master.seen.stops import AxisStop, StopLatch, StopOutcome, StopReport

__all__ = [
    "Adoption",
    "Axis",
    "AxisCommand",
    "AxisConfig",
    "AxisStatus",
    "AxisStop",
    "BusStatus",
    "EmergencyRecord",
    "Event",
    "EventHub",
    "Failsafe",
    "HomeRequest",
    "Identity",
    "Jog",
    "JogEnd",
    "JogRequest",
    "Motion",
    "MotionCancelled",
    "MotionKind",
    "MotionState",
    "MoveRequest",
    "Network",
    "NetworkConfig",
    "Node",
    "NodeConfig",
    "NodeState",
    "NodeStatus",
    "ObjectSpec",
    "Operation",
    "Priority",
    "Reference",
    "SetPositionRequest",
    "StopLatch",
    "StopOutcome",
    "StopReport",
    "Subscription",
    "Switches",
    "Timing",
    "VelocityRequest",
]
