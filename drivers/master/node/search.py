"""Looking for a node: whether something answers under its ID, and whether that is one node alone."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.types import DataType
from drivers.errors import BusError, CanaxisError, SdoAborted
from drivers.master.node.body import NodeBody
from drivers.master.node.identity import DEVICE_TYPE
from drivers.master.sdo.client import Priority


async def find(node: NodeBody, heard: asyncio.Event, not_found: Callable[[], None]) -> None:
    """Probe until something answers; `not_found` is called after each time that nothing did.

    `heard` is set whenever something is heard of the node: that ends a pause at once.
    """
    timing = node.backbone.timing
    pause = timing.probe_first
    while True:
        heard.clear()
        if node.nmt_state is NmtState.STOPPED:
            _wake_from_stopped(node)
        if await _answers(node):
            return
        _wake_from_stopped(node)
        if await _answers(node):
            return
        not_found()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(pause):
                await heard.wait()
        pause = min(2 * pause, timing.probe_last)


async def is_alone(node: NodeBody, restarted_at: float) -> bool:
    """Whether the node that booted at that loop time is the one that was there before; else both are.

    Nothing is sent meanwhile. A node that restarted may start itself and send PDOs, but its axes are
    switched off: one that is energised later than the worst lateness of its last words is another node's.
    If none is, no motor is in danger, and the identification finds two that answer.
    """
    timing = node.backbone.timing
    await asyncio.sleep(timing.sdo_quarantine + 1.5 * timing.pdo_event_timer)
    return not node.energised_after(restarted_at + timing.sdo_quarantine)


def _wake_from_stopped(node: NodeBody) -> None:
    """A node in NMT Stopped has no SDO. It is never reset for that: its axes may be turning."""
    with contextlib.suppress(BusError):
        node.command_nmt(NmtCommand.ENTER_PRE_OPERATIONAL)


async def _answers(node: NodeBody) -> bool:
    try:
        await node.objects.read_as(DEVICE_TYPE, DataType.UNSIGNED32, priority=Priority.CONFIGURE)
    except SdoAborted:
        return True
    except CanaxisError:
        return False
    return True
