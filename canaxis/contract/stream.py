"""What axes do, as it happens, from the service's event stream, without I/O.

`Following` is fed with the bytes of one connection after the other and gives the samples in them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, cast

import httpx

from canaxis.contract.calls import ROOT
from canaxis.contract.exchange import CONNECT, Patience, Request, from_gateway, look, refusal, unreachable
from canaxis.contract.reading import read
from canaxis.errors import BadReply, UnknownAxis
from canaxis.replies import Quantity

QUIET = 45.0
"""Seconds without a byte after which a connection counts as broken; the service sends one every 15."""
TIMEOUT = httpx.Timeout(QUIET, connect=CONNECT)
_OPENING = look(f"{ROOT}/events")
AxisName = tuple[int | str, int | str]
"""A node and an axis, each by number or name."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One point of a plot: where an axis was, and how fast, at a time of the service's clock."""

    node: int
    axis: int
    name: str
    time: datetime
    position: float
    """In `unit`."""
    velocity: float
    """In `unit`/s."""
    unit: str
    state: str | None
    """CiA 402's state."""
    moving: bool
    gap: bool
    """Whether samples of this axis were missed before this one: the line of a plot ends and begins anew."""


@dataclass(frozen=True, slots=True)
class _Event:
    kind: str
    id: str | None
    data: str


@dataclass(frozen=True, slots=True)
class _Axis:
    """As much of an axis's status as a sample needs."""

    node: int
    axis: int
    name: str
    state: str | None
    position: Quantity | None
    velocity: Quantity | None
    moving: bool


class _Events:
    """The bytes of a text/event-stream, as its events (WHATWG HTML 9.2); lines end with LF or CR LF."""

    def __init__(self) -> None:
        self._bytes = b""
        self._fields: dict[str, list[str]] = {}

    def feed(self, chunk: bytes) -> Iterator[_Event]:
        """The events that are whole now."""
        *lines, self._bytes = (self._bytes + chunk).split(b"\n")
        for line in lines:
            text = line.removesuffix(b"\r").decode(errors="replace")
            if text:
                name, _, value = text.partition(":")
                self._fields.setdefault(name, []).append(value.removeprefix(" "))
                continue
            fields, self._fields = self._fields, {}
            if "data" in fields:
                number = fields.get("id", [None])[-1]
                yield _Event(fields.get("event", ["message"])[-1], number, "\n".join(fields["data"]))


class Following:
    """Follows some axes, or all, over breaks of the connection."""

    def __init__(self, axes: tuple[AxisName, ...], patience: Patience) -> None:
        self._asked = axes
        self._patience = patience
        self._pauses = patience.pauses()
        self._wanted: frozenset[tuple[int, int]] | None = None
        self._gaps: set[tuple[int, int]] = set()
        self._known: set[tuple[int, int]] = set()
        self._last_id: str | None = None
        self._events = _Events()

    def request(self) -> Request:
        """What to ask for now, from the beginning or after a break."""
        self._events = _Events()
        self._gaps |= self._known
        headers = {"Accept": "text/event-stream"}
        if self._last_id is not None:
            headers["Last-Event-ID"] = self._last_id
        return replace(_OPENING, headers=headers)

    def opened(self, response: httpx.Response) -> None:
        """Look at the answer's head; its body must have been read if it is an error.

        Raises `CanaxisError`, and `httpx.TransportError` for what may pass: a service that is about to end.
        """
        if response.is_success:
            if not response.headers.get("content-type", "").startswith("text/event-stream"):
                raise BadReply("The answer is no event stream.", hint="Is this a Canaxis service?")
            return
        error = refusal(response)
        if error.code == "shutting_down" or from_gateway(_OPENING, response):
            raise httpx.ConnectError(str(error))
        raise error

    def take(self, chunk: bytes) -> Iterator[Sample]:
        """The samples in some bytes of the stream. Raises `CanaxisError`."""
        for event in self._events.feed(chunk):
            self._pauses = self._patience.pauses()
            self._last_id = event.id or self._last_id
            yield from self._samples(event)

    def pause(self, broke: httpx.TransportError | None) -> float:
        """Seconds before the next request; `broke` is None where the service ended the stream.

        Raises `ServiceUnreachable` once no event came for as long as the patience lasts.
        """
        pause = next(self._pauses, None)
        if pause is None:
            said = "it ended the stream" if broke is None else f"{type(broke).__name__}: {broke}"
            raise unreachable(said, reached=False)
        return pause

    def _samples(self, event: _Event) -> Iterator[Sample]:
        if event.kind == "missed":
            self._gaps |= self._known
        elif event.kind == "snapshot":
            data = _object(event.data)
            self._choose(data)
            rows = data.get("axes")
            for row in cast("list[object]", rows) if isinstance(rows, list) else []:
                yield from self._sample(row, data.get("time"))
        elif event.kind == "axis":
            data = _object(event.data)
            yield from self._sample(data, data.get("time"))

    def _sample(self, row: object, time: object) -> Iterator[Sample]:
        status = read(_Axis, row)
        at = (status.node, status.axis)
        if self._wanted is None or at not in self._wanted:
            return
        if status.position is None or status.velocity is None:
            return
        yield Sample(
            node=status.node,
            axis=status.axis,
            name=status.name,
            time=read(_Moment, {"time": time}).time,
            position=status.position.value,
            velocity=status.velocity.value,
            unit=status.position.unit,
            state=status.state,
            moving=status.moving,
            gap=at in self._gaps,
        )
        self._known.add(at)
        self._gaps.discard(at)

    def _choose(self, snapshot: Mapping[str, Any]) -> None:
        """Find out which axes are meant by their names."""
        nodes = read(_Snapshot, snapshot).nodes
        all_axes = {
            (node.node, axis.axis): ({str(node.node), node.name}, {str(axis.axis), axis.name})
            for node in nodes
            for axis in node.axes
        }
        wanted: set[tuple[int, int]] = set()
        for node, axis in self._asked:
            found = {at for at, (n, a) in all_axes.items() if str(node) in n and str(axis) in a}
            if not found:
                raise UnknownAxis(
                    f"There is no axis {axis!r} of a node {node!r} to follow.", hint="Look at client.nodes()."
                )
            wanted |= found
        self._wanted = frozenset(wanted if self._asked else all_axes)


@dataclass(frozen=True, slots=True)
class _Moment:
    time: datetime


@dataclass(frozen=True, slots=True)
class _NamedAxis:
    axis: int
    name: str


@dataclass(frozen=True, slots=True)
class _NamedNode:
    node: int
    name: str
    axes: tuple[_NamedAxis, ...]


@dataclass(frozen=True, slots=True)
class _Snapshot:
    nodes: tuple[_NamedNode, ...]


def _object(text: str) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except ValueError as error:
        raise BadReply("An event is no JSON.", hint="Is this a Canaxis service?") from error
    return cast("dict[str, Any]", data) if isinstance(data, dict) else {}
