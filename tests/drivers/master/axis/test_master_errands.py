"""An axis's errands: one at a time, and the next may begin as soon as the one before has ended."""

from __future__ import annotations

import asyncio

from drivers.master.axis.errands import Errand, ErrandName, Errands


async def test_an_errand_whose_task_has_ended_is_in_nobodys_way() -> None:
    bugs: list[BaseException] = []
    errands = Errands("node 1 axis 0", bugs.append)
    go_on = asyncio.Event()
    found: list[Errand | None] = []

    async def nothing() -> None:
        return None

    async def waiting() -> None:
        await go_on.wait()

    def begin_another() -> None:  # between the task's last step and its callback
        found.append(errands.current)
        errands.begin(ErrandName.RESETTING, waiting())

    first = errands.begin(ErrandName.STOPPING, nothing())
    asyncio.get_running_loop().call_soon(begin_another)
    await first.join()
    assert found == [None]
    assert errands.current is not None
    assert errands.current.name is ErrandName.RESETTING
    go_on.set()
    await errands.current.join()
    assert errands.current is None
    assert bugs == []
