"""A trajectory: several axes follow a path in csp, set point by set point, each with its SYNC (manual §9).

The set points are sent by a sender with deadlines of its own (`drivers.cyclic`): a process beside the service
where the wire can be opened twice, else the event loop. The service gives it rows ahead of their time, and
watches the drives. Whatever ends it for one axis ends it for all: they come to rest on the path, led by the
sender; if that is not there any more, by the drives' own halt.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from drivers.cia402.power import Controlword
from drivers.cyclic.inloop import LoopSender
from drivers.cyclic.playback import Cause, Row, rows_to_rest
from drivers.cyclic.process import ProcessSender
from drivers.cyclic.sender import CyclePlan, CyclicSender, Phase, Track
from drivers.errors import BadValue, CanaxisError, MotionFailed
from drivers.master.axis.axis import Axis
from drivers.master.axis.commands import AxisCommand
from drivers.master.axis.errands import ErrandName
from drivers.master.motions.motion import MotionKind, MotionState
from drivers.master.plan.prediction import Prediction
from drivers.master.together import trajectory_axis
from drivers.master.together.joint import Joint, require_ready
from drivers.master.together.trajectory_check import Peaks, Survey
from drivers.master.together.trajectory_file import PointFile
from drivers.master.together.trajectory_path import samples

SHORTEST, LONGEST = 1, 100
"""Milliseconds of a cycle."""
_AHEAD = 0.5
"""Seconds of set points that the sender has at hand, beyond what coming to rest takes."""
_PIECE = 256
"""Set points that are worked out without letting others have the event loop."""
_SILENCE = 0.4
"""Seconds, besides ten cycles, without a cycle sent, after which the sender counts as hung."""
_CLEARING = 20.0
"""Seconds that the axes get to come to rest before what waits in the modules is prepared over."""


@dataclass(frozen=True, slots=True)
class TrajectoryRequest:
    """What is to be followed, surveyed already."""

    axes: tuple[Axis, ...]
    points: PointFile
    """Its columns are the axes, in order. The trajectory closes it."""
    period_ms: int
    survey: Survey


def check_period(period_ms: int) -> None:
    """Raises `BadValue` for a cycle that can't be."""
    if not SHORTEST <= period_ms <= LONGEST:
        raise BadValue(
            f"cycle_ms must be {SHORTEST}..{LONGEST}, not {period_ms}.", hint="Give another cycle_ms."
        )


class Trajectory(Joint):
    """One path under way. Made ready and occupied in the same turn of the loop: see `begin_trajectory`."""

    def __init__(self, request: TrajectoryRequest, operation_id: str | None) -> None:
        super().__init__(MotionKind.TRAJECTORY, request.axes, operation_id)
        self._request = request
        self._period = request.period_ms / 1000
        self.prediction = _expected(request.survey)
        self._plan = _plan(request)
        self._sender = self._make_sender()
        self._news = asyncio.Event()
        self._played = asyncio.Event()
        self._parts: dict[Axis, asyncio.Future[None]] = {}
        self._entered: dict[Axis, asyncio.Future[None]] = {}
        self._rested = asyncio.Event()
        self._user = f"trajectory {self.id}"
        self._brake_timer: asyncio.TimerHandle | None = None
        self._heard = (0, 0.0)
        """Cycles that were reported last, and when."""
        self._broken = False
        """Whether an axis's part went wrong: the whole fails as soon as it is known why."""

    def start(self) -> None:
        """Take the SYNC and the axes, before anything is awaited."""
        loop = asyncio.get_running_loop()
        self.backbone.sync.claim(self._user)
        for axis, end in zip(self._axes, self._request.survey.end, strict=True):
            self._entered[axis], self._parts[axis] = loop.create_future(), loop.create_future()
            self.evidence.aim(axis.id, round(end))
        self.occupy(ErrandName.FOLLOWING, self._part, self)
        self.backbone.spawn(self._lead(), self._user)

    # --- the guide of its axes ---

    def brake(self) -> None:
        """See `Guide.brake`. A sender that does not come to rest in time is cut."""
        if self._brake_timer is not None or self._rested.is_set():
            return
        if self._sender.report.phase is not Phase.RUNNING:
            self.cut()
            return
        self._sender.brake()
        longest = 2 * self._plan.reserve * self._period + _SILENCE
        self._brake_timer = asyncio.get_running_loop().call_later(longest, self.cut)

    async def at_rest(self) -> bool:
        """See `Guide.at_rest`."""
        await self._rested.wait()
        report = self._sender.report
        return report.phase is Phase.STANDING and not report.abrupt

    def cut(self) -> None:
        """See `Guide.cut`."""
        self._sender.cut()
        self._rested.set()
        self._news.set()

    # --- each axis's part ---

    async def _part(self, axis: Axis) -> None:
        index = self._axes.index(axis)
        entered, part = self._entered[axis], self._parts[axis]
        try:
            await trajectory_axis.enter(axis, self._request.period_ms, self._plan.start[index])
            entered.set_result(None)
            await trajectory_axis.watch(axis, self._played.is_set, self._played)
            await trajectory_axis.leave(axis, self._request.survey.end[index])
        except Exception:
            self._broken = True
            raise
        finally:
            for future in (entered, part):
                if not future.done():
                    future.set_result(None)

    # --- leading them ---

    async def _lead(self) -> None:
        try:
            await self._follow()
        except CanaxisError as error:
            self.fail(error)
        except Exception as bug:
            self.fail(MotionFailed(f"The service failed: {bug!r}."))
            raise
        finally:
            if self._brake_timer is not None:
                self._brake_timer.cancel()
            self._rested.set()
            self._request.points.close()
            await self._clear_up()

    async def _follow(self) -> None:
        opening = asyncio.ensure_future(self._sender.open())
        ended = asyncio.ensure_future(self.wait())
        try:
            entering = asyncio.gather(opening, *self._entered.values())
            await asyncio.wait((entering, ended), return_when=asyncio.FIRST_COMPLETED)
            if not self.done:
                await entering
            if self._broken:
                await self.wait()
            if self.done:
                entering.cancel()
                await asyncio.gather(entering, return_exceptions=True)
                return
        finally:
            for task in (opening, ended):
                task.cancel()
            await asyncio.gather(opening, ended, return_exceptions=True)
        await self._play()
        if self.done:
            return
        self._judge()
        self._played.set()
        await asyncio.gather(*self._parts.values())
        if self._broken:
            await self.wait()
        if not self.done:
            self.succeed(self._measured())

    async def _play(self) -> None:
        """Give the sender its rows until it has come to its end, whatever that is."""
        rows = (sample.row for sample in samples(self._request.points.points(), self._period))
        given = await self._give(rows, 0)
        self.begin()
        self._sender.go()
        self._heard = (0, asyncio.get_running_loop().time())
        while self._sender.report.phase is Phase.RUNNING or self._sender.report.phase is Phase.READY:
            self._news.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_SILENCE / 2):
                    await self._news.wait()
            self._look_for_life()
            if self._sender.report.phase is Phase.RUNNING:
                self.progress = min(1.0, self._sender.report.taken / max(1, self._request.survey.cycles))
                given = await self._give(rows, given)
        self._rested.set()

    async def _give(self, rows: Iterator[Row], given: int) -> int:
        """As many rows as there is room for; how many were given in all then."""
        room = self._plan.capacity - (given - self._sender.report.taken)
        if given and room < self._plan.capacity // 8:
            return given
        while room > 0:
            piece = list(islice(rows, min(room, _PIECE)))
            if piece:
                self._sender.feed(piece)
            given, room = given + len(piece), room - len(piece)
            if given >= self._request.survey.cycles:
                self._sender.finish()
                break
            await asyncio.sleep(0)
        return given

    def _look_for_life(self) -> None:
        """A sender that sends nothing for too long is hung: cut it, so that the drives are halted."""
        now = asyncio.get_running_loop().time()
        if self._sender.report.cycles != self._heard[0]:
            self._heard = (self._sender.report.cycles, now)
        elif now - self._heard[1] > _SILENCE + 10 * self._period:
            self._sender.cut()
            self._sender.report.why = "It sent nothing any more."

    def _judge(self) -> None:
        """Raise what the sender's end means, unless it played the path to its end."""
        report = self._sender.report
        self.result = self._measured()
        if report.phase is Phase.DEAD:
            raise MotionFailed(
                f"The sender of the set points is gone: {report.why}",
                hint="The drives were halted. See the service's log, then move the axes to the first point.",
            )
        if report.cause is Cause.UNDER_RUN:
            raise MotionFailed(
                "The set points came too late to the sender (under-run); it brought the axes to rest on the "
                "path.",
                hint="Give the machine less to do, or choose a longer cycle.",
            )

    def _measured(self) -> dict[str, int | float | bool | str]:
        report, survey = self._sender.report, self._request.survey
        lateness = report.lateness
        return {
            "duration_s": survey.duration_s,
            "points": survey.points,
            "cycle_ms": self._request.period_ms,
            "cycles": report.cycles,
            "late_cycles": report.slips,
            "under_runs": int(report.cause is Cause.UNDER_RUN),
            "lateness_p50_ms": round(1000 * lateness.share(0.5), 4),
            "lateness_p99_ms": round(1000 * lateness.share(0.99), 4),
            "lateness_max_ms": round(1000 * lateness.longest, 4),
            "sender": "process" if isinstance(self._sender, ProcessSender) else "loop",
        }

    async def _clear_up(self) -> None:
        """Let go of the sender and of the SYNC; a set point that still waits in a module is made harmless.

        Unless the axes were seen to stand at the path's end, one may wait even where every SYNC was sent: in
        a node that did not hear the last of them.
        """
        await self._sender.close()
        try:
            if self.state is not MotionState.SUCCEEDED and self.started is not None:
                for axis in self._axes:
                    axis.tools.drive.note_prepared()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_CLEARING):
                        await asyncio.gather(*(a.stands() for a in self._axes), return_exceptions=True)
                self.backbone.sync.make_harmless(self._axes)
        finally:
            self.backbone.sync.release(self._user)

    # --- the sender ---

    def _make_sender(self) -> CyclicSender:
        way = self.backbone.bus.beside if self.backbone.config.sender_process else None
        if way is None:
            return LoopSender(self._plan, self.backbone.send, self._on_report)
        return ProcessSender(self._plan, way, self._on_report)

    def _on_report(self) -> None:
        self._news.set()


def begin_trajectory(request: TrajectoryRequest, *, operation_id: str | None = None) -> Trajectory:
    """Follow a path that was surveyed.

    Raises, before a frame is sent, `BadValue`, `NotReady`, `AxisBusy`, `StopLatched` or `NodeAway`.
    """
    check_period(request.period_ms)
    axes = request.axes
    for axis in axes:
        trajectory_axis.require_supported(axis)
    require_ready(axes, AxisCommand.MOVE, axes[0].backbone.sync.obstacles() if axes else ())
    trajectory = Trajectory(request, operation_id)
    trajectory.start()
    return trajectory


def _expected(survey: Survey) -> Prediction:
    end = round(survey.end[0]) if len(survey.end) == 1 else None
    return Prediction(survey.duration_s, max(peak.speed for peak in survey.peaks), None, end)


def _plan(request: TrajectoryRequest) -> CyclePlan:
    period, peaks = request.period_ms / 1000, request.survey.peaks
    tracks = tuple(_track(axis, peak, period) for axis, peak in zip(request.axes, peaks, strict=True))
    reserve = 4 + max(
        rows_to_rest(peak.speed * period, track.braking) for peak, track in zip(peaks, tracks, strict=True)
    )
    capacity = reserve + reserve // 2 + 16 + math.ceil(_AHEAD / period)
    first = next(iter(request.points.points()))
    return CyclePlan(period, first.positions, tracks, reserve, capacity)


def _track(axis: Axis, peak: Peaks, period: float) -> Track:
    pdo = axis.pdos.synchronous
    packed = pdo.mapping.pack((Controlword.ENABLE_OPERATION, 0))
    return Track(pdo.cob_id, packed[:-4], axis.config.deceleration * period**2, peak.acceleration * period**2)
