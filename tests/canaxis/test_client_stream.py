"""The stream over breaks, on scripted connections: samples, gaps, and when it gives up."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import aclosing

import httpx
import pytest

from canaxis import (
    AsyncClient,
    BadReply,
    Client,
    Patience,
    Sample,
    ServiceUnreachable,
    Unavailable,
    UnknownAxis,
)

URL = "http://service.example:8402"
NODES = [{"node": 1, "name": "stage", "axes": [{"axis": n, "name": name} for n, name in enumerate("xyz")]}]


def status(axis: int, steps: int | None, **more: object) -> dict[str, object]:
    return {
        "node": 1, "axis": axis, "name": "xyz"[axis], "state": "operation_enabled", "moving": True,
        "position": None if steps is None else {"steps": steps, "value": steps / 100, "unit": "mm"},
        "velocity": None if steps is None else {"steps": 50, "value": 0.5, "unit": "mm/s"},
        **more,
    }  # fmt: skip


def event(number: int | None, kind: str, data: object) -> bytes:
    head = "" if number is None else f"id: {number}\n"
    return f"{head}event: {kind}\ndata: {json.dumps(data, ensure_ascii=False)}\n\n".encode()


def at(second: int) -> str:
    return f"2026-01-01T12:00:{second:02}Z"


def snapshot(number: int, second: int, *axes: dict[str, object]) -> bytes:
    return b"retry: 2000\n\n" + event(
        number, "snapshot", {"time": at(second), "nodes": NODES, "axes": axes, "operations": []}
    )


def moved(number: int, second: int, axis: int, steps: int) -> bytes:
    return event(number, "axis", {**status(axis, steps), "time": at(second)})


class Connection(httpx.SyncByteStream, httpx.AsyncByteStream):
    """Some chunks, then the end or a break."""

    def __init__(self, *chunks: bytes, broken: bool = False) -> None:
        self._chunks = chunks
        self._broken = broken
        self.closed = False

    def __iter__(self) -> Iterator[bytes]:
        yield from self._chunks
        if self._broken:
            raise httpx.ReadError("pulled")

    async def __aiter__(self) -> AsyncIterator[bytes]:
        for chunk in self:
            yield chunk

    def close(self) -> None:
        self.closed = True

    async def aclose(self) -> None:
        self.closed = True


class Scripted:
    """Answers each connection in turn, the last one over and over."""

    def __init__(self, *answers: Connection | httpx.Response | type[httpx.TransportError]) -> None:
        self.answers = list(answers)
        self.sent: list[httpx.Request] = []
        self.pauses: list[float] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.sent.append(request)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Connection):
            return httpx.Response(200, headers={"Content-Type": "text/event-stream"}, stream=answer)
        if isinstance(answer, httpx.Response):
            return answer
        raise answer("scripted", request=request)

    @property
    def last_ids(self) -> list[str | None]:
        """What each connection said that it had."""
        return [request.headers.get("Last-Event-ID") for request in self.sent]

    async def sleep(self, seconds: float) -> None:
        self.pauses.append(seconds)


def collected(script: Scripted, number: int, *axes: tuple[int | str, int | str]) -> list[Sample]:
    """The first samples of a stream."""
    http = httpx.Client(transport=httpx.MockTransport(script))
    client = Client(URL, http=http, patience=Patience(total=0.5), sleep=script.pauses.append)
    samples = client.stream(*axes)
    return [next(samples) for _ in range(number)]


BREAKS = [
    Connection(snapshot(7, 1, status(0, 0), status(1, 100)), moved(8, 2, 0, 10), broken=True),
    Connection(snapshot(20, 5, status(0, 30), status(1, 100)), moved(21, 6, 0, 40)),
]
DRAWN = [(0, 0.0, False), (1, 1.0, False), (0, 0.1, False), (0, 0.3, True), (1, 1.0, True), (0, 0.4, False)]


def test_a_break_is_mended_and_shows_as_a_gap() -> None:
    script = Scripted(*BREAKS)
    seen = collected(script, 6)
    assert [(sample.axis, sample.position, sample.gap) for sample in seen] == DRAWN
    assert script.last_ids == [None, "8"]
    assert script.pauses == [0.1]
    assert seen[2].time.second == 2
    assert (seen[2].unit, seen[2].velocity, seen[2].state, seen[2].moving) == (
        "mm",
        0.5,
        "operation_enabled",
        True,
    )


def test_the_same_in_an_event_loop() -> None:
    script = Scripted(*BREAKS)

    async def collect() -> list[Sample]:
        http = httpx.AsyncClient(transport=httpx.MockTransport(script))
        async with aclosing(AsyncClient(URL, http=http, sleep=script.sleep).stream()) as samples:
            return [await anext(samples) for _ in DRAWN]

    seen = asyncio.run(collect())
    assert [(sample.axis, sample.position, sample.gap) for sample in seen] == DRAWN
    assert script.last_ids == [None, "8"]


def test_a_client_that_was_too_slow_comes_back_soon_and_sees_the_gap() -> None:
    missed = event(None, "missed", {"missed": 12})
    first = Connection(snapshot(3, 1, status(0, 0)) + missed + moved(4, 2, 0, 5))
    script = Scripted(first, Connection(snapshot(9, 3, status(0, 10))))
    assert [sample.gap for sample in collected(script, 3)] == [False, True, True]
    assert script.pauses == [0.1]
    assert script.last_ids == [None, "4"]
    assert first.closed


@pytest.mark.parametrize("axes", [(("stage", "y"),), ((1, 1),), (("1", "y"), ("stage", 1))])
def test_only_the_chosen_axes_are_drawn(axes: tuple[tuple[int | str, int | str], ...]) -> None:
    events = [moved(2 + n, n, n % 3, n) for n in range(6)]
    script = Scripted(Connection(snapshot(1, 0, status(0, 0), status(2, None)), *events))
    assert [(s.axis, s.position) for s in collected(script, 2, *axes)] == [(1, 0.01), (1, 0.04)]


def test_an_axis_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownAxis, match="'w'"):
        collected(Scripted(Connection(snapshot(1, 0))), 1, ("stage", "w"))


def test_events_in_any_pieces_are_read_with_what_is_not_known_passed_over() -> None:
    text = (
        b": keep-alive\n\n"
        + snapshot(1, 0, status(0, 1, name="\u2028\x85x", news=[1])).replace(b"\n", b"\r\n")
        + event(2, "comet", {"seen": True})
        + b"data\n\n"
        + moved(3, 1, 0, 2)
    )
    script = Scripted(Connection(*(text[n : n + 1] for n in range(len(text)))))
    seen = collected(script, 2)
    assert [sample.position for sample in seen] == [0.01, 0.02]
    assert seen[0].name == "\u2028\x85x"


@pytest.mark.parametrize(
    "trouble",
    [
        httpx.ConnectError,
        Connection(),
        Connection(b"retry: 2000\n\n", broken=True),
        httpx.Response(502),
        httpx.Response(503, json={"code": "shutting_down", "detail": "It ends."}),
    ],
)
def test_it_gives_up_when_no_event_comes_for_as_long_as_its_patience_lasts(
    trouble: Connection | httpx.Response | type[httpx.TransportError],
) -> None:
    script = Scripted(Connection(snapshot(5, 1, status(0, 0))), trouble)
    with pytest.raises(ServiceUnreachable):
        collected(script, 2)
    assert script.pauses == pytest.approx([0.1, 0.2, 0.2])
    assert script.last_ids[1:] == ["5"] * 3


def test_a_refusal_is_raised_as_it_is() -> None:
    refused = httpx.Response(
        503, json={"code": "too_many_streams", "detail": "8 are open.", "hint": "Close one."}
    )
    with pytest.raises(Unavailable, match="Close one"):
        collected(Scripted(refused), 1)


def test_what_is_no_event_stream_is_said_to_be_none() -> None:
    with pytest.raises(BadReply):
        collected(Scripted(httpx.Response(200, json={})), 1)
