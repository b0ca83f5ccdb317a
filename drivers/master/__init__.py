"""The async shell: a network of nodes, each supervised by itself, each axis in charge of what it does."""

from __future__ import annotations

from drivers.master.axis import Axis
from drivers.master.config import AxisConfig, NetworkConfig, NodeConfig
from drivers.master.emergencies import EmergencyRecord
from drivers.master.events import Event, EventHub, Subscription
from drivers.master.jogging import Jog, JogEnd
from drivers.master.motion import Motion, MotionCancelled, MotionKind, MotionState, Undertaking
from drivers.master.network import Network
from drivers.master.node import Node
from drivers.master.readiness import AxisCommand
from drivers.master.requests import (
    HomeRequest,
    JogRequest,
    MoveRequest,
    SetPositionRequest,
    VelocityRequest,
)
from drivers.master.sdo_client import Priority
from drivers.master.status import (
    Adoption,
    AxisStatus,
    AxisStop,
    BusStatus,
    Failsafe,
    Identity,
    NodeState,
    NodeStatus,
    Reference,
    StopLatch,
    StopOutcome,
    StopReport,
    Switches,
)
from drivers.master.timing import Timing

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
    "Priority",
    "Reference",
    "SetPositionRequest",
    "StopLatch",
    "StopOutcome",
    "StopReport",
    "Subscription",
    "Switches",
    "Timing",
    "Undertaking",
    "VelocityRequest",
]
