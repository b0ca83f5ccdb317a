"""Problem replies as bytes: for the middleware, which speaks bare ASGI, and for the exception handlers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.http.problems import MEDIA_TYPE, ProblemReply


class Refusal(Exception):
    """The request ends here, with this reply."""

    def __init__(self, reply: ProblemReply, headers: dict[str, str] | None = None) -> None:
        super().__init__(reply.body["detail"])
        self.reply = reply
        self.headers = headers


class ClientGone(Exception):
    """The client left before its request was whole: there is nothing to carry out."""


def problem_response(
    reply: ProblemReply, *, instance: str | None = None, headers: Mapping[str, str] | None = None
) -> Response:
    """A response with the problem as its body; `instance` is the path that was asked for.

    Says `Retry-After` where waiting helps, in whole seconds, rounded up.
    """
    body = reply.body if instance is None else {**reply.body, "instance": instance}
    waiting: dict[str, str] = {}
    if reply.retry_after is not None:
        waiting["Retry-After"] = str(max(1, math.ceil(reply.retry_after)))
    return Response(
        json.dumps(body, ensure_ascii=False, allow_nan=False).encode("utf-8", "backslashreplace"),
        status_code=reply.status,
        media_type=MEDIA_TYPE,
        headers={**waiting, **(headers or {})},
    )


async def refuse(
    scope: Scope, receive: Receive, send: Send, reply: ProblemReply, headers: Mapping[str, str] | None = None
) -> None:
    """Answer a request from within the middleware."""
    await problem_response(reply, instance=scope["path"], headers=headers)(scope, receive, send)
