"""What must hold at every instant of every run, judged by what the simulated modules truly do."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seed_faults import LATEST, LATEST_ANSWER
from seed_joint import Together

from drivers.cia301 import cob
from drivers.cia301.nmt import NmtState
from drivers.cia301.objects import Address
from drivers.cia402 import objects
from drivers.cia402.power import PowerState
from drivers.master import Axis, AxisStatus, Motion, MotionKind, MotionState, NodeState
from drivers.master.motions.motion import Operation, Result
from drivers.master.plan.prediction import predict_home
from drivers.master.plan.requests import HomeRequest, MoveRequest, SetPositionRequest, VelocityRequest
from drivers.sim.motion.axis import SimulatedAxis

if TYPE_CHECKING:
    from seed_world import World

from drivers.bus.frame import Frame

AFTERMATH = 0.25 + LATEST + 0.05
"""Seconds for which a frame that was sent before a command failed may still be under way: a queue that stands
drops it after 0.25 s, the weather makes it late by at most `LATEST`.
"""
FAILSAFE = 0.5 + 0.05
"""1016h, and the module's own time to react: then its motors ramp down."""
NOTICED = 2.5
"""Seconds in which the master has noticed that a module started anew, though its boot-up was lost: it must
miss three of its heartbeats.
"""
GROUP_ENDS = 1.0
"""Seconds after the end of what several axes did together in which each that can be reached was told of it,
besides what its errand takes.
"""
REPORTS = 400
"""Statuses of each sort that are remembered of each axis."""
ANSWERS = 3_000
"""SDO answers that are remembered of each module."""
HIGHEST_SPEED = 60_000
"""Of the clients' commands, steps/s."""


class Violation(Exception):
    """An invariant was found broken."""


@dataclass(eq=False)
class Book:
    """What the clients want of one axis, beside what its motor truly does."""

    name: str
    axis: Axis
    sim: SimulatedAxis
    may_turn: str = ""
    """The command that explains a turning motor; empty: it must stand."""
    may_enable: bool = False
    commands: int = 0
    """Motions that were accepted."""
    enables: int = 0
    enabling: int = 0
    """Clients that wait for an enabling."""
    ended_at: float = 0.0
    enable_ended_at: float = 0.0
    waiting: list[Motion] = field(default_factory=list)
    """Motions that were accepted and are not begun."""
    open: list[tuple[Operation, float, int | None]] = field(default_factory=list)
    """Motions that run, when they must have ended, and where a move must end."""
    void: tuple[int, float, str] | None = None
    """What it did with others is over: at how many commands, since when it is free to stand, and what."""
    homed: bool = False
    """Whether a client asked for a homing since the module's last start."""
    status: AxisStatus | None = None
    state: PowerState | None = None
    turned: bool = False
    statuswords: deque[tuple[float, int, int]] = field(default_factory=lambda: deque(maxlen=REPORTS))
    places: deque[tuple[float, int, int]] = field(default_factory=lambda: deque(maxlen=REPORTS))
    """What its TPDOs said: when, position and velocity; above statusword and mode."""

    @property
    def turns(self) -> bool:
        return not self.sim.motor.standing


class Invariants:
    """Looks at everything, at each instant; `violation` is the first thing that was wrong."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.violation: str | None = None
        self.found = asyncio.Event()
        self._beat_at: dict[int, float] = {}
        self._started_at: dict[int, float] = dict.fromkeys(world.modules, 0.0)
        self._answers: dict[int, deque[tuple[Address, bytes]]] = {
            n: deque(maxlen=ANSWERS) for n in world.modules
        }
        self._ended: list[tuple[Operation, MotionState]] = []
        self._decoders: dict[int, tuple[Book, str] | None] = {}
        self.books: dict[Axis, Book] = {
            axis: Book(f"{node_id}.{axis.number}", axis, world.modules[node_id].module.axes[axis.number])
            for node_id, node in world.network.nodes.items()
            for axis in node.axes
        }
        self._beat = cob.heartbeat(world.network.config.master_node_id)
        for node_id, port in world.module_ports.items():
            port.subscribe(lambda frames, node_id=node_id: self._module_hears(node_id, frames))

    def violated(self, what: str) -> None:
        """Remember the first."""
        if self.violation is None:
            self._world.trace.note("VIOLATION", what)
            self.violation = f"{what}\n{self._world.trace}"
            self.found.set()

    # --- what the clients do

    def commanded(self, axis: Axis, motion: Motion) -> None:
        """The master accepted a motion."""
        book = self.books[axis]
        book.commands += 1
        request = motion.request
        book.may_turn = f"{motion.kind} {request}"
        if motion.kind in (MotionKind.HOME, MotionKind.SET_POSITION):
            book.homed = True
        if motion in axis.queued:
            book.waiting.append(motion)
        else:
            self._begun(book, motion)

    def commanded_together(self, together: Together) -> None:
        """The master accepted what several axes do together."""
        operation = together.operation
        timing = self._world.network.timing
        # Preparing, and before that coming to rest from something else and the starts of other groups.
        before = 12 * (timing.sdo_queue + timing.sdo_response + timing.sdo_quarantine) + 30.0
        bound = before + together.lasts * timing.motion_factor + timing.motion_margin + timing.stuck
        for axis, goal in zip(operation.axes, together.goals, strict=True):
            book = self._book(*axis)
            book.commands += 1
            book.may_turn = str(together)
            book.open.append((operation, self._now + bound, goal))

    def _begun(self, book: Book, motion: Motion) -> None:
        """Its turn has come: a relative move begins from here."""
        request = motion.request
        move = request.as_move if isinstance(request, VelocityRequest) else request
        goal: int | None = None
        if isinstance(move, MoveRequest):
            goal = move.target + (self.position(book) if move.relative else 0)
        bound = self._bound(motion, 0 if goal is None else goal - self.position(book))
        if isinstance(request, SetPositionRequest):
            goal = request.position
        book.open.append((motion, self._now + bound, goal))

    def acknowledged(
        self, axis: Axis, what: str, commands: int, *, disabled: bool = False, enables: int = 0
    ) -> None:
        """The master said that the axis stands; `commands` and `enables` are those of before it was asked."""
        book = self.books[axis]
        if book.commands == commands:
            for operation in {id(entry[0]): entry[0] for entry in book.open}.values():
                self._over(operation)
            if book.turns:
                self.violated(f"{book.name}: {what} was acknowledged while the motor turns")
            book.may_turn = ""
        if disabled and book.enables == enables:
            if book.state is PowerState.OPERATION_ENABLED:
                self.violated(f"{book.name}: {what} was acknowledged while the axis is enabled")
            book.may_enable = False

    def _over(self, operation: Operation) -> None:
        """One axis's part has ended: unless they are commanded anew, the others come to rest too."""
        if isinstance(operation, Motion):
            return
        for axis in operation.axes:
            book = self._book(*axis)
            if book.open and book.open[-1][0] is operation and book.void is None:
                book.void = book.commands, self._now, str(operation.kind)

    def restarted(self, node_id: int) -> None:
        """A module starts anew: whatever was commanded is void."""
        self._started_at[node_id] = self._now
        for book in self.books.values():
            if book.axis.node.node_id == node_id:
                book.may_turn = ""
                book.may_enable = book.homed = False

    # --- what the wire carries

    def crossing(self, frame: Frame) -> None:
        """A frame is on the wire, before anything happens to it: what a module truly says."""
        if frame.error or frame.extended or frame.remote:
            return
        service, node_id = cob.classify(frame.cob_id)
        if service is cob.Service.SDO_RESPONSE and node_id in self._world.modules:
            self._note_answer(node_id, frame.data)
        elif 0x180 <= frame.cob_id < 0x580 and frame.cob_id >> 7 & 1:
            self._note_pdo(frame)

    def _note_answer(self, node_id: int, data: bytes) -> None:
        """An expedited answer to a read."""
        if len(data) == 8 and data[0] & 0xE3 == 0x43:
            size = 4 - (data[0] >> 2 & 3)
            address = Address(int.from_bytes(data[1:3], "little"), data[3])
            self._answers[node_id].append((address, data[4 : 4 + size]))

    def said(self, node_id: int, address: Address, value: int) -> bool:
        """Whether a module gave this value when it was asked for the object lately."""
        return any(
            asked == address and (value - int.from_bytes(data, "little")) % (1 << 8 * len(data)) == 0
            for asked, data in self._answers[node_id]
        )

    def _note_pdo(self, frame: Frame) -> None:
        """A TPDO, read with the mapping that the module itself holds."""
        found = self._decoder(frame.cob_id)
        if found is None:
            return
        book, kind = found
        data = frame.data
        if kind == "status":
            mode = int.from_bytes(data[2:3], "little", signed=True)
            book.statuswords.append((self._now, int.from_bytes(data[:2], "little"), mode))
        else:
            place = int.from_bytes(data[:4], "little", signed=True)
            book.places.append((self._now, place, int.from_bytes(data[4:8], "little", signed=True)))

    def _decoder(self, cob_id: int) -> tuple[Book, str] | None:
        if cob_id not in self._decoders:
            found = self._look_up(cob_id)
            if found is None:
                return None
            self._decoders[cob_id] = found
        return self._decoders[cob_id]

    def _look_up(self, cob_id: int) -> tuple[Book, str] | None:
        for node_id, node in self._world.modules.items():
            dictionary = node.module.dictionary
            for number in range(0x1800, 0x1A00):
                try:
                    if dictionary.stored(Address(number, 1)) & 0x800007FF != cob_id:
                        continue
                    mapped = dictionary.stored(Address(number + 0x200, 1)) >> 16
                except KeyError:
                    continue
                axis, base = divmod(mapped - 0x6000, 0x800)
                kind = {objects.STATUSWORD: "status", objects.POSITION: "place"}.get(base + 0x6000)
                if kind is not None:
                    return self._book(node_id, axis), kind
        return None

    def _module_hears(self, node_id: int, frames: Sequence[Frame]) -> None:
        node = self._world.modules[node_id]
        for frame in frames:
            if frame.cob_id == self._beat and len(frame.data) == 1 and not node.faults.deaf:
                self._beat_at[node_id] = self._now

    # --- every instant

    def look(self) -> None:
        """All that can be judged at one instant."""
        if self.violation is not None:
            return
        for book in self.books.values():
            self._look_at_motor(book)
            if book.void is not None:
                self._look_at_void(book)
            if book.sim.state is not book.state:
                self._look_at_state(book)
            if book.waiting:
                self._look_at_line(book)
            if book.open:
                self._look_at_motions(book)
            if book.axis.status is not book.status:
                self._look_at_status(book)
        failure = self._world.network.failure
        if failure is not None:
            self.violated(f"the service failed: {failure!r}")

    def _look_at_motor(self, book: Book) -> None:
        if book.turns:
            if not book.turned:
                self._world.trace.note("motor", f"{book.name} turns: {book.may_turn}")
                book.turned = True
            if not book.may_turn:
                self.violated(f"{book.name}: the motor turns though nobody commands it")
            elif self._unprotected(book):
                self.violated(f"{book.name}: the motor turns though our heartbeat ended")
            return
        if book.turned:
            book.turned = False
            self._world.trace.note("motor", f"{book.name} stands at {self.position(book)}")
        if (
            book.may_turn
            and not book.open
            and not book.waiting
            and book.axis.errand is None
            and self._now > book.ended_at + AFTERMATH
        ):
            enabled = book.sim.state is PowerState.OPERATION_ENABLED
            if not (enabled and book.may_turn.startswith(MotionKind.VELOCITY)):
                book.may_turn = ""

    def _look_at_void(self, book: Book) -> None:
        assert book.void is not None
        commands, since, what = book.void
        axis = book.axis
        if book.commands != commands or not book.turns:
            if book.commands != commands or (self._now > since + GROUP_ENDS and axis.errand is None):
                book.void = None
        elif (
            axis.errand is not None
            or axis.node.state is not NodeState.OPERATIONAL
            or axis.status.stale
            or self._world.loop.stalled
        ):
            book.void = commands, self._now, what
        elif self._now > since + GROUP_ENDS + HIGHEST_SPEED / axis.config.deceleration:
            self.violated(f"{book.name}: it still turns though the {what} that it took part in is over")

    def _unprotected(self, book: Book) -> bool:
        node_id = book.axis.node.node_id
        module = self._world.modules[node_id].module
        if module.nmt_state is not NmtState.OPERATIONAL:
            return False
        ramp = HIGHEST_SPEED / book.axis.config.quick_stop_deceleration
        return self._now > self._beat_at.get(node_id, 0.0) + FAILSAFE + ramp

    def _look_at_state(self, book: Book) -> None:
        state = book.sim.state
        self._world.trace.note("drive", f"{book.name} is {state}")
        book.state = state
        if state is PowerState.OPERATION_ENABLED and not book.may_enable:
            self.violated(f"{book.name}: the axis was enabled though nobody asked for it")

    def _look_at_line(self, book: Book) -> None:
        """What waits is begun in its order, or ended without being begun; never forgotten."""
        for motion in tuple(book.waiting):
            if motion in book.axis.queued:
                if book.axis.errand is None and not self._world.loop.stalled:
                    self.violated(f"{book.name}: {motion.kind} {motion.request} waits for nothing")
                continue
            if motion is not book.waiting[0] and book.axis.motion is motion:
                self.violated(f"{book.name}: {motion.kind} {motion.request} was begun before its turn")
            book.waiting.remove(motion)
            self._begun(book, motion)

    def _look_at_motions(self, book: Book) -> None:
        for entry in tuple(book.open):
            motion, deadline, goal = entry
            if motion.done:
                book.open.remove(entry)
                book.ended_at = self._now
                self._world.trace.note(
                    "motion", f"{book.name} {motion.kind} {motion.state} {motion.error or ''}"
                )
                if motion.state is not MotionState.SUCCEEDED and not book.open:
                    self._void(book, motion)
                self._ended.append((motion, motion.state))
                self._look_at_end(book, motion, goal)
            elif isinstance(motion, Motion) and book.axis.errand is None and not self._world.loop.stalled:
                self.violated(
                    f"{book.name}: {motion.kind} {motion.request} is {motion.state}, and nobody is at it"
                )
            elif self._now > deadline + self._world.loop.stalled_in_all:
                self.violated(f"{book.name}: {motion.kind} ({book.may_turn}) has not ended in time")

    def _void(self, book: Book, operation: Operation) -> None:
        if not isinstance(operation, Motion) and book.void is None:
            book.void = book.commands, self._now, str(operation.kind)

    def _look_at_end(self, book: Book, motion: Operation, goal: int | None) -> None:
        succeeded = motion.state is MotionState.SUCCEEDED
        told = motion.result is not None
        measured = motion.kind is MotionKind.TRAJECTORY  # what its sender came to, however it ended
        if motion.ended is None or (told is not succeeded and not (told and measured)):
            self.violated(
                f"{book.name}: a motion that {motion.state} says {motion.result} and {motion.error}"
            )
        if motion.state is not MotionState.SUCCEEDED:
            if motion.error is None:
                self.violated(f"{book.name}: a motion ended as {motion.state} and doesn't say why")
            return
        if self._now < self._started_at[book.axis.node.node_id] + LATEST:
            return  # it restarted in the same moment: the master can't know yet
        match motion.kind:
            case MotionKind.MOVE:
                if book.turns or self.position(book) != goal:
                    self.violated(f"{book.name}: a move to {goal} succeeded at {self.position(book)}")
                if book.commands and not book.open and not book.waiting:
                    book.may_turn = ""
            case MotionKind.HOME:
                if book.turns or self.position(book) != book.axis.config.home_offset:
                    self.violated(f"{book.name}: a homing succeeded at {self.position(book)}")
                if not book.open and not book.waiting:
                    book.may_turn = ""
            case MotionKind.COORDINATED_MOVE | MotionKind.TRAJECTORY:
                off = 0 if goal is None else abs(self.position(book) - goal)
                if book.turns or off > (motion.kind is MotionKind.TRAJECTORY):
                    self.violated(
                        f"{book.name}: a {motion.kind} to {goal} succeeded at {self.position(book)}"
                    )
                if not book.open and not book.waiting:
                    book.may_turn = ""
            case MotionKind.SET_POSITION:
                if self.position(book) != goal:
                    self.violated(f"{book.name}: set to {goal}, it stands at {self.position(book)}")
            case MotionKind.VELOCITY:
                if goal is not None and self.position(book) != goal:
                    self.violated(f"{book.name}: a travel to {goal} succeeded at {self.position(book)}")
                self._look_at_result(book, motion.result or {})
            case _:
                pass

    def _look_at_result(self, book: Book, result: Result) -> None:
        if not result.get("turning") and not book.open and not book.waiting:
            if book.turns:
                self.violated(f"{book.name}: a velocity of 0 was reached while the motor turns")
            book.may_turn = ""

    def _look_at_status(self, book: Book) -> None:
        status = book.status = book.axis.status
        known = self._started_at[book.axis.node.node_id] + NOTICED + self._world.loop.stalled_in_all
        if status.referenced and not book.homed and self._now > known:
            self.violated(f"{book.name}: referenced though nobody homed it since its module's last start")
        late = LATEST + LATEST_ANSWER + self._world.loop.stalled_in_all + 0.05
        since = (self._now if status.stale else status.updated) - late
        if status.stale and self._read(book, status):
            return
        # After a restart each half is unknown until its own TPDO comes: what isn't shown need not be true.
        word = (status.statusword, status.mode)
        said = any(report[1:] == word for report in book.statuswords if status.stale or report[0] >= since)
        if not said and status.state is not None:
            self.violated(f"{book.name}: a status shows {word} of the drive, which it didn't say: {status}")
        place = (status.position, status.velocity)
        was = any(report[1:] == place for report in book.places if status.stale or report[0] >= since)
        if not was and status.position is not None and not self._read(book, status):
            self.violated(f"{book.name}: a status shows {place}, where the axis was not: {status}")

    def _read(self, book: Book, status: AxisStatus) -> bool:
        """Whether what a status shows was read by SDO from this axis."""
        node_id, offset = book.axis.node.node_id, 0x800 * book.axis.number
        word = status.statusword
        return self.said(node_id, Address(objects.POSITION + offset), status.position or 0) and (
            self.said(node_id, Address(objects.STATUSWORD + offset), word)
            or any(report[1] == word for report in book.statuswords)
        )

    # --- at the end

    def closed(self) -> None:
        """The network was closed: nothing is left of it, and every axis stands."""
        for book in self.books.values():
            if book.turns:
                self.violated(f"{book.name}: the motor turns after the network was closed")
            if book.sim.state is PowerState.OPERATION_ENABLED:
                self.violated(f"{book.name}: enabled after the network was closed")
        for motion, state in self._ended:
            if motion.state is not state:
                self.violated(f"a {motion.kind} that had {state} has {motion.state} now")
        timers = self._world.loop.service_timers()
        if timers:
            self.violated(f"timers left behind: {timers}")
        for node in self._world.network.nodes.values():
            if not node.sdo.idle:
                self.violated(f"node {node.node_id}: the SDO channel is not idle after the close")

    # --- helpers

    @property
    def _now(self) -> float:
        return self._world.loop.time()

    def position(self, book: Book) -> int:
        """Where the axis truly is, steps."""
        return book.sim.read(objects.POSITION, 0, self._now) or 0

    def _book(self, node_id: int, axis: int) -> Book:
        return self.books[self._world.network.nodes[node_id].axes[axis]]

    def _bound(self, motion: Motion, distance: int) -> float:
        """Seconds in which a motion has ended, by `Timing`: parameters, mode, handshake and the motion."""
        timing = self._world.network.timing
        before = 6 * (timing.sdo_queue + timing.sdo_response + timing.sdo_quarantine) + 2 * timing.mode_change
        request, config = motion.request, self._world.network.axis(motion.axis).config
        match request:
            case MoveRequest():
                velocity = request.velocity or config.velocity
                gentlest = min(
                    request.acceleration or config.acceleration, request.deceleration or config.deceleration
                )
                lasts = abs(distance) / velocity + 2 * velocity / gentlest
            case SetPositionRequest():
                lasts = 10.0
            case HomeRequest():
                lasts = request.timeout_s or predict_home(config, request).duration_s
            case VelocityRequest():
                lasts = 2 * HIGHEST_SPEED / (request.acceleration or config.acceleration)
                lasts += (request.duration_s or 0) + (request.travel or 0) / max(1, abs(request.velocity))
                if request.held:
                    return 3600.0  # until somebody ends it
        return before + timing.handshake + lasts * timing.motion_factor + timing.motion_margin + timing.stuck
