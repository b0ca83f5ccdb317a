"""One axis's part of a trajectory: into csp without a jump, watched on the way, out of it at standstill
(manual §9).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Statusword
from drivers.errors import MotionFailed, MotionTimeout, NotReady
from drivers.master.axis.axis import Axis
from drivers.master.drive import stopping
from drivers.master.drive.tools import AxisTools
from drivers.master.sdo.client import Priority
from drivers.master.seen.status import AxisStatus
from drivers.obstacles import NO_CSP

_MILLISECONDS = -3
"""60C2h:2: the period is given in units of 10^-3 s (manual §9.1.10)."""
_LOOK_EACH = 1.0
"""Seconds after which a wait for the path's end is begun anew."""


def require_supported(axis: Axis) -> None:
    """Raise `NotReady` for a model without csp."""
    if Mode.CYCLIC_SYNC_POSITION not in axis.node.profile.modes:
        found = NO_CSP.found(f"A {axis.node.config.model} has no csp mode.")
        raise NotReady(
            f"Axis {axis.name} can't follow a trajectory: {found.message}",
            obstacles=(found,),
            node=axis.node.node_id,
            axis=axis.number,
        )


async def enter(axis: Axis, period_ms: int, start: float) -> None:
    """Into csp, with the target where the axis stands: 607Ah counts as soon as the mode does.

    What the drive goes by is the demand (6062h), so that is what the target is made of. Raises
    `MotionFailed` if it is not where the path begins; `SdoError`, `TransitionTimeout`, `AxisFault`.
    """
    tools = axis.tools
    await tools.parameters.require(
        {
            (objects.INTERPOLATION_PERIOD, 1): period_ms,
            (objects.INTERPOLATION_PERIOD, 2): _MILLISECONDS,
            (objects.POSITION_OFFSET, 0): 0,
        }
    )
    where = tools.objects.address(objects.POSITION_DEMAND, 0, tools.number)
    demand = await tools.objects.read_int(where, priority=Priority.CONTROL)
    if abs(demand - start) > 1.0 + tools.config.position_tolerance:
        raise MotionFailed(
            f"Axis {tools.config.name} stands at {demand} (6062h), the path begins at {start:.10g} steps.",
            hint="Move the axis to the first point, then send the trajectory.",
            **tools.where,
        )
    target = tools.objects.address(objects.TARGET_POSITION, 0, tools.number)
    await tools.objects.write(target, demand, priority=Priority.CONTROL)
    await tools.enter_mode(Mode.CYCLIC_SYNC_POSITION)
    tools.require_enabled(tools.drive.status)


async def watch(axis: Axis, until: Callable[[], bool], nudge: asyncio.Event) -> None:
    """Look at every status until `until` is true; `nudge` says that it may have become so.

    Raises `AxisFault`, and `MotionFailed` for a following error or a drive that left OPERATION_ENABLED or
    csp.
    """
    tools = axis.tools
    waker = asyncio.ensure_future(nudge.wait())
    try:
        while not until():
            seen = asyncio.ensure_future(tools.drive.until(lambda s: _bad(tools, s), _LOOK_EACH))
            try:
                await asyncio.wait((seen, waker), return_when=asyncio.FIRST_COMPLETED)
            finally:
                seen.cancel()
                await asyncio.gather(seen, return_exceptions=True)
            if not seen.cancelled():
                seen.result()
    finally:
        waker.cancel()
        await asyncio.gather(waker, return_exceptions=True)


async def leave(axis: Axis, end: float) -> None:
    """See the axis stand on the path's end, then out of csp: halt, mode 0. Raises `MotionTimeout`."""
    tools = axis.tools
    tolerance = 1.0 + tools.config.position_tolerance

    def there(status: AxisStatus) -> bool:
        _bad(tools, status)
        position = status.position
        return not status.moving and position is not None and abs(position - end) <= tolerance

    if not await tools.drive.until(there, tools.timing.motion_margin):
        raise MotionTimeout(
            f"Axis {tools.config.name} stands at {tools.drive.status.position}, not at the path's end "
            f"{end:.10g}.",
            hint="Look for lost set points (a full bus), a limit, or too low a current.",
            **tools.where,
        )
    stopping.begin(tools)
    await stopping.come_to_rest(tools)


def _bad(tools: AxisTools, status: AxisStatus) -> bool:
    """Raises what is wrong; never true."""
    tools.require_enabled(status)
    if status.mode is not Mode.CYCLIC_SYNC_POSITION:
        raise MotionFailed(
            f"Axis {tools.config.name} left csp during the trajectory.",
            hint="Look for a second master on the bus.",
            **tools.where,
        )
    if status.statusword & Statusword.BIT13:
        raise MotionFailed(
            f"Axis {tools.config.name} reports a following error (6041h bit 13).",
            hint="Check its load, its current and the following error window (6065h).",
            **tools.where,
        )
    return False
