"""How long a client is ready to wait for the end of what it commanded."""

from __future__ import annotations

import asyncio
import re
from typing import Annotated

from fastapi import Depends, Header, Query, Request

from drivers.master.motions.motion import Operation

LONGEST_WAIT = 600.0
_PREFER_WAIT = re.compile(r'(?:^|[,;])\s*wait\s*=\s*"?(\d{1,9})"?\s*(?=$|[,;])', re.IGNORECASE)


class Wait:
    """How long a client is ready to wait for the end of an operation."""

    def __init__(self, request: Request, seconds: float, *, preferred: bool = False) -> None:
        self.seconds = seconds
        self.preferred = preferred
        """Whether it came from the Prefer header, which wants to hear that it was applied."""
        self._request = request

    async def until_end(self, motion: Operation) -> bool:
        """Wait for a motion, as long as the client wants and is there; True if it ended.

        The motion goes on without the client, but its Idempotency-Key must not stay in flight.
        """
        if self.seconds <= 0:
            return motion.done
        end = asyncio.ensure_future(motion.wait(self.seconds))
        gone = asyncio.ensure_future(self._gone())
        try:
            await asyncio.wait((end, gone), return_when=asyncio.FIRST_COMPLETED)
        finally:
            end.cancel()
            gone.cancel()
            await asyncio.gather(end, gone, return_exceptions=True)
        return motion.done

    async def _gone(self) -> None:
        while (await self._request.receive())["type"] != "http.disconnect":
            pass  # the body of a GET


async def get_wait(
    request: Request,
    wait: Annotated[
        float | None,
        Query(ge=0, le=LONGEST_WAIT, allow_inf_nan=False, description="Seconds to wait for the end."),
    ] = None,
    prefer: Annotated[
        str | None,
        Header(description="`wait=SECONDS` (RFC 7240), like the query; ignored if it is anything else."),
    ] = None,
) -> Wait:
    """From the query, else from the Prefer header; a preference that can't be met is ignored (RFC 7240)."""
    if wait is not None:
        return Wait(request, wait)
    found = _PREFER_WAIT.search(prefer or "")
    if found is None:
        return Wait(request, 0.0)
    return Wait(request, min(LONGEST_WAIT, float(found[1])), preferred=True)


WaitDep = Annotated[Wait, Depends(get_wait)]
