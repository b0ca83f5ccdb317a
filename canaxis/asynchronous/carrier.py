"""Carries requests to a service and answers back: what client, node, axis and operation stand on."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncGenerator
from typing import TypeVar

import httpx

from canaxis.asynchronous.jog import AsyncJog
from canaxis.asynchronous.waiting import Sleep, sleep
from canaxis.contract import stream
from canaxis.contract.exchange import Answer, Call, Exchange, Patience, Request
from canaxis.contract.stream import AxisName, Following, Sample

T = TypeVar("T")
TIMEOUT = 30.0


class AsyncCarrier:
    """A service's address, and how long to wait for it: see `AsyncClient`, which is one."""

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        timeout: float = TIMEOUT,
        patience: Patience | None = None,
        http: httpx.AsyncClient | None = None,
        sleep: Sleep = sleep,
    ) -> None:
        self._url = url.rstrip("/")
        self._headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._timeout = timeout
        self._patience = patience or Patience()
        self._http = http or httpx.AsyncClient(trust_env=False)
        self._owned = http is None
        self._sleep = sleep

    async def close(self) -> None:
        """Close the connections. What moves goes on moving: see `stop_all`."""
        if self._owned:
            await self._http.aclose()

    async def stream(self, *axes: AxisName) -> AsyncGenerator[Sample]:
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
                response = await self._http.send(request, stream=True)
                async with contextlib.aclosing(response):
                    if not response.is_success:
                        await response.aread()
                    following.opened(response)
                    async for chunk in response.aiter_bytes():
                        for sample in following.take(chunk):
                            yield sample
            except httpx.TransportError as error:
                broke = error
            await self._sleep(following.pause(broke))

    async def run(self, call: Call[T]) -> T:
        """Make a call, repeating it as `Patience` says."""
        return await self.carry_out(call.exchange(self._patience))

    async def carry_out(self, exchange: Exchange[T]) -> T:
        """Send what an exchange wants sent, until it has its result."""
        try:
            step = next(exchange)
            while True:
                if step.pause > 0:
                    await self._sleep(step.pause)
                step = exchange.send(await self._answer(step.request))
        except StopIteration as end:
            return end.value

    def jog(self, path: str) -> AsyncJog:
        """Open a connection that jogs the axis at `path`."""
        return AsyncJog(f"ws{self._url.removeprefix('http')}{path}/jog", self._headers)

    @property
    def patience(self) -> Patience:
        """How long a request without an answer is repeated."""
        return self._patience

    async def _answer(self, request: Request) -> Answer:
        try:
            return await self._http.send(self._build(request, request.timeout(self._timeout)))
        except httpx.TransportError as error:
            return error

    def _build(self, request: Request, timeout: httpx.Timeout) -> httpx.Request:
        return self._http.build_request(
            request.method,
            self._url + request.path,
            params=dict(request.query) or None,
            json=request.body,
            content=None if request.path_body is None else request.path_body.async_pieces(),
            headers={**self._headers, **request.headers},
            timeout=timeout,
        )
