"""Opening the bus: at once, or as soon as there is one."""

from __future__ import annotations

import asyncio

import structlog

from drivers.errors import BusDown
from drivers.master.network import Network

FIRST_RETRY = 0.5
LAST_RETRY = 5.0
"""Seconds between two tries to open a bus that wasn't there at the start."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis")


class BusOpener:
    """Opens the network; without a bus, tries again in the background."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.problem: str | None = "The bus was not opened yet."
        """Why the network isn't open; None once it is."""
        self._trying: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Try once, and go on trying if that fails."""
        if not await self._try():
            self._trying = asyncio.create_task(self._keep_trying(), name="bus opener")

    async def close(self) -> None:
        """Try no more. The network is closed by whoever made it."""
        if self._trying is not None:
            self._trying.cancel()
            await asyncio.gather(self._trying, return_exceptions=True)

    async def _try(self) -> bool:
        try:
            await self.network.open()
        except BusDown as error:
            if self.problem != error.message:
                log.warning("bus not open", problem=error.message, hint=error.hint)
            self.problem = error.message
            return False
        self.problem = None
        return True

    async def _keep_trying(self) -> None:
        pause = FIRST_RETRY
        opened = False
        while not opened:
            await asyncio.sleep(pause)
            pause = min(LAST_RETRY, pause * 2)
            opened = await self._try()
