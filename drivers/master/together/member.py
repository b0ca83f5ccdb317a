"""One axis of a coordinated move: its way, its start by SYNC, its arrival."""

from __future__ import annotations

import asyncio

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import Controlword, Statusword
from drivers.cia402.setpoint import Evidence, SetPointHandshake
from drivers.errors import MotionFailed
from drivers.master.axis.axis import Axis
from drivers.master.drive.tools import AxisTools, Parameter
from drivers.master.motions.profile_position import check_target
from drivers.master.plan.axis_fields import RAMP_V1, RAMP_V2, START_VELOCITY
from drivers.master.plan.requests import MoveRequest
from drivers.master.sdo.client import Priority
from drivers.master.seen.boot_log import Change
from drivers.master.seen.status import AxisStatus
from drivers.master.together.coordination import END_VELOCITY, Profile, Way


class Member:
    """What the group knows of one of its axes, and has it do. It decides nothing about the others."""

    def __init__(self, axis: Axis, request: MoveRequest) -> None:
        self.axis = axis
        self.request = request
        self.start = axis.status.position or 0
        """Steps; the demand position (6062h) once `locate` has read it."""
        self.target = self._aim()
        self.profile: Profile | None = None
        """What it was told; None: it has no way to go, or nothing was told yet."""
        self.started = asyncio.Event()
        """Whether it showed that it took the set point."""
        self.arrived = asyncio.Event()
        self.settled_at: float | None = None
        """Loop time of the first statusword that showed it standing on its target."""
        self._handshake = SetPointHandshake(axis.backbone.timing.handshake)
        self._under_way = False
        self._standing_since: float | None = None
        self._has_turned = False

    @property
    def tools(self) -> AxisTools:
        """The axis's."""
        return self.axis.tools

    @property
    def moves(self) -> bool:
        """Whether it has a way to go."""
        return self.target != self.start

    @property
    def way(self) -> Way:
        """With what was asked, else what the axis is configured with."""
        config, request = self.axis.config, self.request
        return Way(
            abs(self.target - self.start),
            request.velocity or config.velocity,
            request.acceleration or config.acceleration,
            request.deceleration or config.deceleration,
        )

    # --- preparing ---

    def check(self) -> None:
        """Raise `BadValue` for a target that the axis would refuse."""
        check_target(self.tools, self.target)

    async def locate(self) -> None:
        """Read where it stands, and count a relative target from there. Raises as a move does."""
        tools = self.tools
        address = tools.objects.address(objects.POSITION_DEMAND, 0, tools.number)
        self.start = await tools.objects.read_int(address, priority=Priority.CONTROL)
        self.target = self._aim()
        self.check()

    async def configure(self) -> None:
        """Write what `profile` says, confirmed; then enter the mode. Nothing moves by it."""
        tools, profile, config = self.tools, self.profile, self.axis.config
        if profile is not None:
            await tools.parameters.require(_rates(profile))
            if config.start_velocity or config.end_velocity != END_VELOCITY:
                # VSTOP is named first so that it comes back first: VSTART never passes it (manual §1.5).
                await self._lend(objects.END_VELOCITY, config.end_velocity, config.end_velocity)
                await self._lend(START_VELOCITY, 0, config.start_velocity)
                await self._lend(objects.END_VELOCITY, END_VELOCITY, config.end_velocity)
            if config.ramp_v1 or config.ramp_v2:
                await self._lend(RAMP_V1, 0, config.ramp_v1)
                await self._lend(RAMP_V2, 0, config.ramp_v2)
            await tools.enter_mode(Mode.PROFILE_POSITION)
        tools.require_enabled(tools.drive.status)

    def changes(self) -> tuple[Change, ...]:
        """What `configure` would write of what isn't so already, as far as that is known."""
        config, needed = self.axis.config, {} if self.profile is None else _rates(self.profile)
        if self.profile is not None and (config.start_velocity or config.end_velocity != END_VELOCITY):
            needed |= {(START_VELOCITY, 0): 0, (objects.END_VELOCITY, 0): END_VELOCITY}
        if self.profile is not None and (config.ramp_v1 or config.ramp_v2):
            needed |= {(RAMP_V1, 0): 0, (RAMP_V2, 0): 0}
        return self.tools.parameters.changes(needed)

    async def settle(self) -> None:
        """Give the axis its own ramp back."""
        await self.tools.parameters.settle()

    # --- starting ---

    def prepare_target(self) -> None:
        """Have the target ready with bit 4 low: what the next SYNC takes moves nothing."""
        self.tools.drive.prepare_position(Controlword.ENABLE_OPERATION, self.target)

    async def confirm_target(self) -> None:
        """See by SDO that the SYNC had the module take the target. Raises `MotionFailed` if not."""
        tools = self.tools
        address = tools.objects.address(objects.TARGET_POSITION, 0, tools.number)
        held = await tools.objects.read_int(address, priority=Priority.CONTROL)
        if held != self.target:
            raise MotionFailed(
                f"Axis {self.axis.name} did not take its target by SYNC: 607Ah is {held} instead of "
                f"{self.target}. Nothing was started.",
                hint="Look for lost frames (GET /api/v1/bus) and for the module's 1005h and RPDO 4.",
                **tools.where,
            )

    def prepare_start(self) -> None:
        """Have the edge of bit 4 ready for the next SYNC, whoever sends that."""
        drive = self.tools.drive
        now = asyncio.get_running_loop().time()
        controlword = self._handshake.start(drive.status.statusword, now)
        self._under_way = True
        drive.prepare_position(controlword, self.target)

    async def reached_by_frames(self) -> None:
        """An SDO answer: the node has taken from the bus what was sent to it before this was asked."""
        tools = self.tools
        address = tools.objects.address(objects.STATUSWORD, 0, tools.number)
        await tools.objects.read_int(address, priority=Priority.CONTROL)

    def lower_set_point(self) -> None:
        """Take bit 4 back, by the asynchronous RPDO 2."""
        self.tools.drive.lower_set_point()

    def confirm_end(self) -> None:
        """Take bit 4 back once more: the wire may have lost the first."""
        self.tools.drive.command_position(Controlword.ENABLE_OPERATION, self.target)

    # --- under way ---

    def look(self, status: AxisStatus) -> bool:
        """Note what a status tells; never the end of the looking. Raises what ends the move of all."""
        tools = self.tools
        tools.require_enabled(status)
        if not self._under_way or self.arrived.is_set():
            return False
        now = asyncio.get_running_loop().time()
        if not self.started.is_set():
            self._handshake.feed(status.statusword, now)
            if self._handshake.evidence is Evidence.NONE and not self._there(status):
                return False
            tools.drive.note_taken()
            self.started.set()
        if self._settled(status) and self.settled_at is None:
            self.settled_at = tools.drive.status_at or now
        if self._there(status):
            self.arrived.set()
            return False
        self._look_for_standstill(status, now)
        return False

    def share_done(self) -> float | None:
        """How much of its way lies behind it, 0..1."""
        position = self.axis.status.position
        if position is None or not self.moves:
            return None
        return min(1.0, max(0.0, (position - self.start) / (self.target - self.start)))

    # --- inside ---

    def _aim(self) -> int:
        return self.start + self.request.target if self.request.relative else self.request.target

    async def _lend(self, index: int, value: int, owed: int) -> None:
        await self.tools.parameters.lend(index, 0, value, owed=owed)

    @staticmethod
    def _settled(status: AxisStatus) -> bool:
        return status.target_reached and not status.moving and not status.statusword & Statusword.BIT12

    def _there(self, status: AxisStatus) -> bool:
        return (
            self._settled(status)
            and status.position is not None
            and abs(status.position - self.target) <= self.axis.config.position_tolerance
        )

    def _look_for_standstill(self, status: AxisStatus, now: float) -> None:
        """The others must not go on while this one stands somewhere else."""
        timing, switches = self.tools.timing, status.switches
        if status.moving or self._standing_since is None:
            self._has_turned = self._has_turned or status.moving
            self._standing_since = now
            return
        stood = now - self._standing_since
        limit = switches.positive_limit if self.target > self.start else switches.negative_limit
        at_limit = limit and (self._has_turned or stood > timing.group_start)
        if at_limit or stood > timing.stuck:
            why = "; a limit switch is engaged" if limit else ""
            raise MotionFailed(
                f"Axis {self.axis.name} stands at {status.position} instead of {self.target}{why}.",
                hint="Look for a limit switch, a software limit (607Dh), an obstacle or too low a current.",
                **self.tools.where,
            )


def _rates(profile: Profile) -> dict[Parameter, int]:
    return {
        (objects.PROFILE_VELOCITY, 0): profile.velocity,
        (objects.PROFILE_ACCELERATION, 0): profile.acceleration,
        (objects.PROFILE_DECELERATION, 0): profile.deceleration,
    }
