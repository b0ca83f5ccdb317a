"""The bodies of commands, taken whole before anything is carried out: bounded, in time, declared as JSON."""

from __future__ import annotations

import asyncio

from starlette.types import Message, Receive

from app.access.head import Head
from app.access.roles import is_stop
from app.http.problems import problem
from app.http.replies import ClientGone, Refusal
from app.http.uploads import JSON

MAX_BODY = 64 * 1024
HANG_UP = {"Connection": "close"}
"""For a request whose rest is not worth waiting for."""


def _too_large() -> Refusal:
    return Refusal(problem("body_too_large", f"The body is larger than {MAX_BODY} bytes."), HANG_UP)


async def read_body(receive: Receive, head: Head, within: float) -> bytes:
    """The whole body. Raises `Refusal` as soon as it is known to be too large (413) or too slow (408).

    `within`: seconds in which it must be here. Raises `ClientGone`.
    """
    if head.length is not None and head.length > MAX_BODY:
        raise _too_large()
    try:
        async with asyncio.timeout(within):
            return await _whole(receive)
    except TimeoutError:
        raise Refusal(
            problem("request_timeout", f"The body was not here after {within:g} s."), HANG_UP
        ) from None


async def _whole(receive: Receive) -> bytes:
    chunks: list[bytes] = []
    size = 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientGone
        chunk: bytes = message.get("body", b"")
        size += len(chunk)
        if size > MAX_BODY:
            raise _too_large()
        chunks.append(chunk)
        if not message.get("more_body", False):
            return b"".join(chunks)


def check_content_type(path: str, head: Head, body: bytes) -> None:
    """Raises `Refusal` (415) for a command that is not declared to be JSON."""
    if not body and is_stop(path):
        return  # stopping is the safe direction: a bare POST will do, whatever a tool declares it to be
    if head.media_type != JSON:
        raise Refusal(
            problem(
                "json_required", "A command needs the content type application/json, even without a body."
            )
        )


def replay(body: bytes, receive: Receive) -> Receive:
    """A `receive` that gives the body in one piece, then what the server says."""
    given = False

    async def once() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return once
