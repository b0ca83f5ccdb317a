"""Measurements for Prometheus: one registry for each service, filled when it is asked."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.audit import AuditTrail
from app.bus.opening import BusOpener
from app.events.streams import Streams
from app.http.parts import Part
from app.operations.register import OperationRegister
from drivers.master.network import Network
from drivers.master.seen.status import NodeState

STREAM = "stream_events"
"""The operation that lasts as long as its client likes."""
BUCKETS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30)


@dataclasses.dataclass(frozen=True, slots=True)
class Measured:
    """The parts of the service that have counters."""

    network: Network
    bus: BusOpener
    operations: OperationRegister
    streams: Streams
    audit: AuditTrail


class Metrics:
    """The service's registry, and the histogram that the middleware feeds."""

    def __init__(self, measured: Measured) -> None:
        self.registry = CollectorRegistry()
        self.latency = Histogram(
            "canaxis_http_request_duration_seconds",
            "Time from a request to the end of its answer; event streams excluded.",
            ("operation", "status"),
            registry=self.registry,
            buckets=BUCKETS,
        )
        self.registry.register(ServiceCollector(measured))

    def render(self) -> bytes:
        """The text that Prometheus reads."""
        return generate_latest(self.registry)


class ServiceCollector(Collector):
    """Reads the drivers' counters at the moment of the scrape; nothing is counted twice."""

    def __init__(self, measured: Measured) -> None:
        self._measured = measured

    def describe(self) -> Iterator[Metric]:
        """Nothing up front: registering must not read the counters."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """All families."""
        yield from self._of_bus()
        yield from self._of_nodes()
        yield from self._of_axes()
        yield from self._of_service()

    def _of_bus(self) -> Iterator[Metric]:
        status = self._measured.network.bus_status()
        up = GaugeMetricFamily("canaxis_bus_up", "Whether frames can be sent.")
        up.add_metric((), float(self._measured.bus.problem is None and status.state.can_send))
        yield up
        for name, value in dataclasses.asdict(status.counters).items():
            yield CounterMetricFamily(f"canaxis_bus_{name}", f"Bus counter {name}.", value=value)

    def _of_nodes(self) -> Iterator[Metric]:
        state = GaugeMetricFamily(
            "canaxis_node_state", "1 for the state that the node is in.", labels=("node", "state")
        )
        waiting = GaugeMetricFamily(
            "canaxis_node_sdo_waiting", "Object transfers that wait for their turn.", labels=("node",)
        )
        families: dict[str, CounterMetricFamily] = {}
        for node in self._measured.network.nodes.values():
            status = node.status()
            waiting.add_metric((str(node.node_id),), node.sdo.waiting)
            for each in NodeState:
                state.add_metric((str(node.node_id), each.value), float(status.state is each))
            counters = dataclasses.asdict(status.counters)
            flat = {k: v for k, v in counters.items() if isinstance(v, int)}
            flat |= {f"sdo_{k}": v for k, v in dataclasses.asdict(status.counters.sdo).items()}
            for name, value in flat.items():
                family = families.setdefault(
                    name,
                    CounterMetricFamily(f"canaxis_node_{name}", f"Node counter {name}.", labels=("node",)),
                )
                family.add_metric((str(node.node_id),), value)
        yield from (state, waiting)
        yield from families.values()

    def _of_axes(self) -> Iterator[Metric]:
        labels = ("node", "axis")
        position = GaugeMetricFamily("canaxis_axis_position_steps", "Last reported position.", labels=labels)
        moving = GaugeMetricFamily("canaxis_axis_moving", "Whether the motor turns.", labels=labels)
        stale = GaugeMetricFamily(
            "canaxis_axis_stale", "Whether the status is too old to rely on.", labels=labels
        )
        for node in self._measured.network.nodes.values():
            for axis in node.axes:
                key = (str(node.node_id), str(axis.number))
                if axis.status.position is not None:
                    position.add_metric(key, axis.status.position)
                moving.add_metric(key, float(axis.status.moving))
                stale.add_metric(key, float(axis.status.stale))
        yield from (position, moving, stale)

    def _of_service(self) -> Iterator[Metric]:
        measured = self._measured
        started = CounterMetricFamily("canaxis_operations_started", "Operations begun.", labels=("kind",))
        for kind, count in measured.operations.started.items():
            started.add_metric((kind.value,), count)
        yield started
        yield GaugeMetricFamily("canaxis_event_streams", "Open event streams.", value=len(measured.streams))
        yield CounterMetricFamily(
            "canaxis_event_streams_missed_events",
            "Events that slow clients lost.",
            value=measured.streams.missed,
        )
        yield GaugeMetricFamily(
            "canaxis_audit_up",
            "Whether the record of commands is written.",
            value=float(measured.audit.problem is None),
        )
        yield CounterMetricFamily(
            "canaxis_audit_lost", "Commands that are missing in its file.", value=measured.audit.lost
        )
        latched = float(measured.network.stop_latched is not None)
        yield GaugeMetricFamily("canaxis_stop_latched", "Whether a stop is latched.", value=latched)


METRICS: Part[Metrics] = Part("metrics")


class LatencyMiddleware:
    """Measures every request that reached a route, by its operation in the API's document."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, then note the time."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began = time.perf_counter()
        status = 500

        async def watch(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self.app(scope, receive, watch)
        finally:
            operation = getattr(scope.get("route"), "name", None)
            metrics = METRICS.of_any(scope)
            if operation is not None and metrics is not None and operation != STREAM:
                metrics.latency.labels(operation, str(status)).observe(time.perf_counter() - began)
