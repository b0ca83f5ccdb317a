"""After the module lost messages: whether a motion may go on, asked in a task of its own, once at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.errors import CanaxisError, MotionFailed
from drivers.master.drive.after_losses import contradiction
from drivers.master.drive.tools import AxisTools
from drivers.master.motions.motion import Operation
from drivers.master.seen.emergencies import EmergencyRecord


class LossCheck:
    """Of one axis."""

    def __init__(
        self,
        tools: AxisTools,
        node_name: str,
        on_contradiction: Callable[[Operation, CanaxisError], None],
        on_bug: Callable[[BaseException], None],
    ) -> None:
        """`on_contradiction` is told of a motion whose last command the drive doesn't show, and the error."""
        self._tools = tools
        self._node_name = node_name
        self._on_contradiction = on_contradiction
        self._on_bug = on_bug
        self._task: asyncio.Task[None] | None = None

    def begin(self, motion: Operation, record: EmergencyRecord) -> None:
        """Ask the drive; not where nothing was commanded yet, or it is being asked already."""
        if motion.started is None or self._task is not None:
            return
        name = f"{self._tools.config.name}: confirmation"
        self._task = asyncio.create_task(self._ask(motion, record), name=name)

    async def close(self) -> None:
        """End the task."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    async def _ask(self, motion: Operation, record: EmergencyRecord) -> None:
        try:
            wrong = await contradiction(self._tools)
        except CanaxisError as error:
            wrong = f"it could not be asked: {error.message}"
        except Exception as bug:
            self._on_bug(bug)
            return
        finally:
            self._task = None
        if wrong:
            self._on_contradiction(
                motion,
                MotionFailed(
                    f"Node {self._node_name} reported {record.title} ({record.code:04X}h) during the motion, "
                    f"and what was commanded last is unconfirmed: {wrong}. A stop was sent.",
                    hint=record.remedy,
                    **self._tools.where,
                ),
            )
