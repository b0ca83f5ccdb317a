"""A request and its answer, without I/O: what is sent again, when, and how an answer is understood.

An `Exchange` is a generator: it yields what to send and is given what came back. Both clients run it,
each with its own kind of waiting, so that the rules are here once.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar, cast

import httpx

from canaxis import errors
from canaxis.contract.path import PathBody
from canaxis.contract.reading import read

T = TypeVar("T")

CONNECT = 5.0
"""Seconds that a connection may take to come about."""
GATEWAY = frozenset({502, 503, 504})
"""What a proxy says when it can't reach the service; an answer of the service itself has a `code`."""
LATER = frozenset({"key_in_flight", "too_many_requests"})
"""Problems that pass by themselves: the same request is answered a little later."""
NOTHING_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
HOPELESS = (httpx.UnsupportedProtocol, httpx.LocalProtocolError)
"""Mistakes in the request, which no repetition cures."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to repeat a request that got no answer: pauses that double from `first` to `longest` seconds.

    `total`: seconds of pauses, all together; 0 never repeats. The requests' own time comes on top.
    Raises `ValueError` for a pause of nothing, which would never come to an end.
    """

    total: float = 15.0
    first: float = 0.1
    longest: float = 2.0

    def __post_init__(self) -> None:
        if not (self.first > 0 and self.longest > 0):
            raise ValueError("first and longest must be above 0 seconds")

    def pauses(self) -> Iterator[float]:
        """The seconds before each repetition."""
        pause, left = self.first, self.total
        while left > 0:
            pause = min(pause, self.longest, left)
            yield pause
            left = round(left - pause, 9)  # what rounding leaves is no pause
            pause *= 2


@dataclass(frozen=True, slots=True)
class Request:
    """One request below ``/api/v1``, or at the root; the same value may be sent again."""

    method: str
    path: str
    query: Mapping[str, str | int | float] = field(default_factory=dict[str, str | int | float])
    body: Mapping[str, Any] | None = None
    path_body: PathBody | None = None
    """Instead of `body`: one that is sent piece by piece."""
    headers: Mapping[str, str] = field(default_factory=dict[str, str])
    waits: float = 0.0
    """Seconds that the service is asked to wait before it answers."""
    safe: bool = False
    """Whether carrying it out twice is the same as once."""
    accepts: frozenset[int] = frozenset()
    """Statuses of errors whose body is the wanted answer all the same."""

    @property
    def repeatable(self) -> bool:
        """Whether it may be sent again without an answer: what is safe or has its key, and is still there."""
        there = self.path_body is None or self.path_body.repeatable
        return there and (self.safe or "Idempotency-Key" in self.headers)

    def timeout(self, seconds: float) -> httpx.Timeout:
        """The time it may take, where any answer may take `seconds`."""
        return httpx.Timeout(seconds + self.waits, connect=min(CONNECT, seconds))


def look(path: str, query: Mapping[str, str | int | float | None] | None = None) -> Request:
    """A request that only reads; members of `query` that are None are left out."""
    given = {name: value for name, value in (query or {}).items() if value is not None}
    return Request("GET", path, query=given, safe=True)


def command(
    path: str, body: Mapping[str, Any] | None = None, *, key: str | None = None, method: str = "POST"
) -> Request:
    """A command, under `key` or a new one: however often it is sent, it is carried out once."""
    return Request(method, path, body=body or {}, headers={"Idempotency-Key": key or uuid.uuid4().hex})


def stop(path: str, body: Mapping[str, Any] | None = None) -> Request:
    """A stop: it has no key, since each repetition has to stop anew."""
    return Request("POST", path, body=body or {}, safe=True)


class Step(NamedTuple):
    """What an exchange wants next: a pause of some seconds, then this request sent."""

    request: Request
    pause: float = 0.0


Answer: TypeAlias = httpx.Response | httpx.TransportError
Exchange: TypeAlias = Generator[Step, Answer, T]


@dataclass(frozen=True, slots=True)
class Call(Generic[T]):
    """A request, and what its answer means."""

    request: Request
    understand: Callable[[Any], T]

    def exchange(self, patience: Patience) -> Exchange[T]:
        """Send it until there is an answer, as long as `patience` lasts. Raises `CanaxisError`."""
        response = yield from _answered(self.request, patience)
        return self.understand(_content(response, self.request.accepts))


class TaggedCall(Call[T]):
    """A call whose answer gets its ETag as one more member, `etag`."""

    def exchange(self, patience: Patience) -> Exchange[T]:
        """See `Call.exchange`."""
        response = yield from _answered(self.request, patience)
        content = _content(response, self.request.accepts)
        if isinstance(content, dict):
            content = {**cast("dict[str, Any]", content), "etag": response.headers.get("ETag", "")}
        return self.understand(content)


def asking(request: Request, kind: type[T]) -> Call[T]:
    """The call whose answer is a `kind`."""
    return Call(request, lambda data: read(kind, data))


def _answered(request: Request, patience: Patience) -> Exchange[httpx.Response]:
    answer = yield Step(request)
    reached = _reached(answer)
    for pause in patience.pauses() if request.repeatable else ():
        if not _worth_repeating(request, answer):
            break
        answer = yield Step(request, _asked_pause(answer, pause, patience))
        reached |= _reached(answer)
    if isinstance(answer, httpx.TransportError):
        raise unreachable(f"{type(answer).__name__}: {answer}", reached=reached and not request.safe)
    if from_gateway(request, answer):
        raise unreachable(f"a proxy answered {answer.status_code}", reached=not request.safe)
    return answer


def _reached(answer: Answer) -> bool:
    return isinstance(answer, httpx.Response) or not isinstance(answer, NOTHING_SENT + HOPELESS)


def _worth_repeating(request: Request, answer: Answer) -> bool:
    if isinstance(answer, httpx.TransportError):
        return not isinstance(answer, HOPELESS)
    return from_gateway(request, answer) or _problem(answer).get("code") in LATER


def from_gateway(request: Request, response: httpx.Response) -> bool:
    """Whether it is the word of a proxy that can't reach the service."""
    status = response.status_code
    return status in GATEWAY and status not in request.accepts and "code" not in _problem(response)


def _asked_pause(answer: Answer, pause: float, patience: Patience) -> float:
    """The pause, or what the answer's Retry-After asks for up to the longest."""
    if isinstance(answer, httpx.Response):
        asked = answer.headers.get("retry-after", "")
        if asked.isascii() and asked.isdecimal():
            return min(max(pause, float(asked)), patience.longest)
    return pause


def unreachable(said: str, *, reached: bool) -> errors.ServiceUnreachable:
    """The error after the last attempt; `reached`: whether any of them may have been carried out."""
    if reached:
        return errors.OutcomeUnknown(
            f"The service took the command but gave no answer ({said}).",
            hint="It may be carried out: look at the axis's status and at the operations first.",
        )
    return errors.ServiceUnreachable(
        f"The service can't be reached ({said}).", hint="Check that it runs, and its address and port."
    )


def refusal(response: httpx.Response) -> errors.CanaxisError:
    """The error that an answer tells of."""
    problem = _problem(response)
    if "code" not in problem:
        return errors.BadReply(
            f"The answer has the status {response.status_code} and is no problem object.",
            hint="Is this a Canaxis service?",
            status=response.status_code,
        )
    return errors.of_problem(problem, response.status_code)


def _content(response: httpx.Response, accepts: frozenset[int]) -> object:
    if not response.is_success and (response.status_code not in accepts or "code" in _problem(response)):
        raise refusal(response)
    try:
        return response.json()
    except ValueError as error:
        raise errors.BadReply(
            "The answer is no JSON.", hint="Is this a Canaxis service?", status=response.status_code
        ) from error


def _problem(response: httpx.Response) -> Mapping[str, Any]:
    if response.is_success:
        return {}
    try:
        data = response.json()
    except ValueError:
        return {}
    return cast("Mapping[str, Any]", data) if isinstance(data, dict) else {}
