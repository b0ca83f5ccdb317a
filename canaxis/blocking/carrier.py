# Made by `make client` from canaxis/asynchronous/carrier.py: change that.
"""Carries requests to a service and answers back: what client, node, axis and operation stand on."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from typing import TypeVar

import httpx

from canaxis.blocking.jog import Jog
from canaxis.blocking.waiting import Sleep, sleep
from canaxis.contract import stream
from canaxis.contract.exchange import Answer, Call, Exchange, Patience, Request
from canaxis.contract.stream import AxisName, Following, Sample

T = TypeVar("T")
TIMEOUT = 30.0


class Carrier:
    """A service's address, and how long to wait for it: see `Client`, which is one."""

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        timeout: float = TIMEOUT,
        patience: Patience | None = None,
        http: httpx.Client | None = None,
        sleep: Sleep = sleep,
    ) -> None:
        self._url = url.rstrip("/")
        self._headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._timeout = timeout
        self._patience = patience or Patience()
        self._http = http or httpx.Client(trust_env=False)
        self._owned = http is None
        self._sleep = sleep

    def close(self) -> None:
        """Close the connections. What moves goes on moving: see `stop_all`."""
        if self._owned:
            self._http.close()

    def stream(self, *axes: AxisName) -> Generator[Sample]:
        """What axes do as it happens: ``("stage", "x")`` and so on, or every axis. Never ends by itself.

        First where each axis is, then each change, some fifty a second at most. The connection is made anew
        when it breaks; `Sample.gap` tells of what was missed. Raises `UnknownAxis`, and `ServiceUnreachable`
        once no event came for as long as the patience lasts.
        """
        following = Following(axes, self._patience)
        while True:
            broke = None
            try:
                request = self._build(following.request(), stream.TIMEOUT)
                response = self._http.send(request, stream=True)
                with contextlib.closing(response):
                    if not response.is_success:
                        response.read()
                    following.opened(response)
                    for chunk in response.iter_bytes():
                        yield from following.take(chunk)
            except httpx.TransportError as error:
                broke = error
            self._sleep(following.pause(broke))

    def run(self, call: Call[T]) -> T:
        """Make a call, repeating it as `Patience` says."""
        return self.carry_out(call.exchange(self._patience))

    def carry_out(self, exchange: Exchange[T]) -> T:
        """Send what an exchange wants sent, until it has its result."""
        try:
            step = next(exchange)
            while True:
                if step.pause > 0:
                    self._sleep(step.pause)
                step = exchange.send(self._answer(step.request))
        except StopIteration as end:
            return end.value

    def jog(self, path: str) -> Jog:
        """Open a connection that jogs the axis at `path`."""
        return Jog(f"ws{self._url.removeprefix('http')}{path}/jog", self._headers)

    @property
    def patience(self) -> Patience:
        """How long a request without an answer is repeated."""
        return self._patience

    def _answer(self, request: Request) -> Answer:
        try:
            return self._http.send(self._build(request, request.timeout(self._timeout)))
        except httpx.TransportError as error:
            return error

    def _build(self, request: Request, timeout: httpx.Timeout) -> httpx.Request:
        return self._http.build_request(
            request.method,
            self._url + request.path,
            params=dict(request.query) or None,
            json=request.body,
            content=None if request.path_body is None else request.path_body.pieces(),
            headers={**self._headers, **request.headers},
            timeout=timeout,
        )
