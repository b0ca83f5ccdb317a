"""Mistakes made on purpose: each is found within a few seeds, or the invariants would guard nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from seed_run import run

from drivers.cia301.sdo import Done, SdoUpload
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword
from drivers.master import Axis, Network
from drivers.master.drive import stopping
from drivers.master.drive.drive import Drive
from drivers.master.ground.router import Handler, Router
from drivers.master.motions import profile_position
from drivers.master.motions.motion import Operation
from drivers.master.sdo.client import SdoClient
from drivers.master.together.coordinated_move import CoordinatedMove
from drivers.master.together.member import Member

FEW = 8
"""Seeds in which each mistake must have been found."""
FIRST = {"the_others_of_a_group_are_forgotten_when_it_is_over": 34}
"""Where to begin, if not with seed 0: what a mistake needs may be rare among the seeds."""


def a_relative_move_is_sent_twice(patch: pytest.MonkeyPatch) -> None:
    move = profile_position.move

    async def again(tools: Any, request: Any, motion: Any) -> Any:
        result = await move(tools, request, motion)
        return await move(tools, request, motion) if request.relative else result

    patch.setattr(profile_position, "move", again)


def any_answer_is_taken_for_the_awaited_one(patch: pytest.MonkeyPatch) -> None:
    feed = SdoUpload.feed

    def careless(self: SdoUpload, data: bytes) -> Any:
        step = feed(self, data)
        return Done(data[4:]) if data[0] & 0xE2 == 0x42 and not isinstance(step, Done) else step

    patch.setattr(SdoUpload, "feed", careless)
    patch.setattr(SdoClient, "_is_quiet_for", lambda self, job, now: True)


def a_stop_for_everything_forgets_an_axis(patch: pytest.MonkeyPatch) -> None:
    axes = Network._axes
    patch.setattr(Network, "_axes", lambda self: axes(self)[:-1])


def a_stop_is_acknowledged_before_standstill(patch: pytest.MonkeyPatch) -> None:
    async def hasty(tools: Any) -> None:
        return None

    patch.setattr(stopping, "come_to_rest", hasty)


def a_status_goes_to_the_wrong_axis(patch: pytest.MonkeyPatch) -> None:
    add = Router.add
    crossed = {0x181: 0x1FE, 0x1FE: 0x181}  # TPDO 1 of the first two axes of node 1

    def wrong(self: Router, cob_id: int, handler: Handler) -> None:
        add(self, crossed.get(cob_id, cob_id), handler)

    patch.setattr(Router, "add", wrong)


def an_axis_is_enabled_when_its_node_comes_back(patch: pytest.MonkeyPatch) -> None:
    back = Axis.back_in_reach

    def eager(self: Axis) -> None:
        back(self)
        self._drive.command(Controlword.SHUTDOWN, Mode.NO_MODE)
        self._drive.command(Controlword.SWITCH_ON, Mode.NO_MODE)
        self._drive.command(Controlword.ENABLE_OPERATION, Mode.NO_MODE)

    patch.setattr(Axis, "back_in_reach", eager)


def a_motion_ends_and_nobody_says_so(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Operation, "fail", lambda self, error: None)


def an_old_velocity_starts_with_the_mode(patch: pytest.MonkeyPatch) -> None:
    halt = Drive.halt

    def halt_without_zero(self: Drive, *, urgent: bool = True) -> None:
        if self.mode is Mode.PROFILE_VELOCITY:
            return
        halt(self, urgent=urgent)

    patch.setattr(Drive, "halt", halt_without_zero)


def the_others_of_a_group_are_forgotten_when_it_is_over(patch: pytest.MonkeyPatch) -> None:
    abort = CoordinatedMove._abort

    def forgetful(self: CoordinatedMove, *why: Any) -> None:
        axes = self._axes
        self._axes = ()
        try:
            abort(self, *why)
        finally:
            self._axes = axes

    patch.setattr(CoordinatedMove, "_abort", forgetful)


def a_group_takes_one_for_arrived_that_still_turns(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Member, "_there", lambda self, status: self.started.is_set())


MISTAKES: Mapping[str, Callable[[pytest.MonkeyPatch], None]] = {
    made.__name__: made
    for made in (
        a_relative_move_is_sent_twice,
        any_answer_is_taken_for_the_awaited_one,
        a_stop_for_everything_forgets_an_axis,
        a_stop_is_acknowledged_before_standstill,
        a_status_goes_to_the_wrong_axis,
        an_axis_is_enabled_when_its_node_comes_back,
        a_motion_ends_and_nobody_says_so,
        an_old_velocity_starts_with_the_mode,
        the_others_of_a_group_are_forgotten_when_it_is_over,
        a_group_takes_one_for_arrived_that_still_turns,
    )
}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_found_within_a_few_seeds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    MISTAKES[name](monkeypatch)
    first = FIRST.get(name, 0)
    assert any(run(seed).violation is not None for seed in range(first, first + FEW))
