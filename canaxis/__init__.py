"""The Python client: axes of a Canaxis service from a script, a notebook or a scheduler.

``from canaxis import Client``, or ``AsyncClient`` in an event loop; both say the same. It knows the service's
HTTP contract and nothing else of it, and needs httpx alone. docs/python-client.md shows it at work.
"""

from canaxis.asynchronous.axis import AsyncAxis
from canaxis.asynchronous.client import AsyncClient, AsyncLease
from canaxis.asynchronous.jog import AsyncJog
from canaxis.asynchronous.node import AsyncNode
from canaxis.asynchronous.operation import AsyncOperation
from canaxis.blocking.axis import Axis
from canaxis.blocking.client import Client, Lease
from canaxis.blocking.jog import Jog
from canaxis.blocking.node import Node
from canaxis.blocking.operation import Operation
from canaxis.contract.exchange import Patience
from canaxis.contract.press import JogStopped
from canaxis.contract.stream import Sample
from canaxis.errors import (
    AxisFault,
    BadReply,
    BadValue,
    BusDown,
    Busy,
    CanaxisError,
    Conflict,
    Forbidden,
    GuardedObject,
    InputTimeout,
    KeyInFlight,
    KeyReused,
    Leased,
    LeaseLost,
    Locked,
    MotionFailed,
    MotionTimeout,
    NoAnswer,
    NodeAway,
    NodeFailed,
    NotFound,
    NotReady,
    OperationCancelled,
    OutcomeUnknown,
    PreconditionFailed,
    PreconditionRequired,
    QueueFull,
    SdoAborted,
    ServiceFault,
    ServiceRestarted,
    ServiceUnreachable,
    StopLatched,
    TooManyRequests,
    Unauthorized,
    Unavailable,
    UnknownAxis,
    UnknownNode,
    UnknownObject,
    UnknownOperation,
    UnknownPosition,
    UnknownTerminal,
    WaitTimeout,
)
from canaxis.obstacles import Action, Obstacle
from canaxis.replies.preview import Preview
from canaxis.replies.settings import AxisSettings

__version__ = "0.1.0"

__all__ = [
    "Action",
    "AsyncAxis",
    "AsyncClient",
    "AsyncJog",
    "AsyncLease",
    "AsyncNode",
    "AsyncOperation",
    "Axis",
    "AxisFault",
    "AxisSettings",
    "BadReply",
    "BadValue",
    "BusDown",
    "Busy",
    "CanaxisError",
    "Client",
    "Conflict",
    "Forbidden",
    "GuardedObject",
    "InputTimeout",
    "Jog",
    "JogStopped",
    "KeyInFlight",
    "KeyReused",
    "Lease",
    "LeaseLost",
    "Leased",
    "Locked",
    "MotionFailed",
    "MotionTimeout",
    "NoAnswer",
    "Node",
    "NodeAway",
    "NodeFailed",
    "NotFound",
    "NotReady",
    "Obstacle",
    "Operation",
    "OperationCancelled",
    "OutcomeUnknown",
    "Patience",
    "PreconditionFailed",
    "PreconditionRequired",
    "Preview",
    "QueueFull",
    "Sample",
    "SdoAborted",
    "ServiceFault",
    "ServiceRestarted",
    "ServiceUnreachable",
    "StopLatched",
    "TooManyRequests",
    "Unauthorized",
    "Unavailable",
    "UnknownAxis",
    "UnknownNode",
    "UnknownObject",
    "UnknownOperation",
    "UnknownPosition",
    "UnknownTerminal",
    "WaitTimeout",
    "__version__",
]
