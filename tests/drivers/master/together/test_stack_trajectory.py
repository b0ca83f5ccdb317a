"""Three axes on a path in csp, at 10 ms, on a virtual clock."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Callable, Sequence

import pytest
from stack_kit import Stack, stack_of, until

from drivers.bus.faults import cob_id
from drivers.bus.frame import Frame
from drivers.cia301.cob import emcy
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState
from drivers.cyclic.inloop import LoopSender
from drivers.cyclic.playback import Row
from drivers.errors import AxisBusy, AxisFault, MotionFailed, NodeAway, NotReady, TrajectoryRefused
from drivers.master import AxisConfig, MoveRequest, NodeState, VelocityRequest
from drivers.master.axis.axis import Axis
from drivers.master.motions.motion import MotionState
from drivers.master.together.trajectory import Trajectory, TrajectoryRequest, begin_trajectory
from drivers.master.together.trajectory_check import survey
from drivers.master.together.trajectory_file import PointFile

PERIOD = 0.01
SECONDS = 2.0
SLOW = 20.0
"""Seconds in which no acceleration is in the way."""
Way = Callable[[float], float]


def wave(reach: float) -> Way:
    """To and fro with rests at both ends: peak speed reach * pi / SECONDS."""
    return lambda t: reach / 2 * (1 - math.cos(2 * math.pi * t / SECONDS))


WAYS = (wave(20_000), wave(-8_000), wave(3_000))


def points_of(*ways: Way, seconds: float = SECONDS, each: float = 0.05) -> PointFile:
    points = PointFile(len(ways))
    for number in range(round(seconds / each) + 1):
        t = number * each
        speeds = [(w(t + 1e-5) - w(t - 1e-5)) / 2e-5 for w in ways]
        points.add(t, [w(t) for w in ways], speeds)
    return points


def follow(axes: tuple[Axis, ...], points: PointFile, period_ms: int = 10) -> Trajectory:
    try:
        found = survey(points.points(), period_ms / 1000, axes)
        return begin_trajectory(TrajectoryRequest(axes, points, period_ms, found))
    except BaseException:
        points.close()
        raise


def motors(stack: Stack) -> list[float]:
    now = asyncio.get_running_loop().time()
    return [axis.motor.position(now) for axis in stack.modules[1].module.axes]


@pytest.mark.parametrize("share", [0.99, 1.01])
@pytest.mark.looptime
async def test_a_path_is_refused_that_is_faster_than_its_axis_may_be(stack: Stack, share: float) -> None:
    (axis, *_) = await stack.enabled()
    top = axis.config.velocity * share

    def smooth(t: float) -> float:  # its speed is half a wave: nothing, then `top`, then nothing
        return top * SLOW / math.pi * (1 - math.cos(math.pi * t / SLOW))

    points = points_of(smooth, seconds=SLOW)
    try:
        if share < 1:
            assert survey(points.points(), 0.01, (axis,)).peaks[0].speed == pytest.approx(top, rel=0.01)
            return
        with pytest.raises(TrajectoryRefused) as refused:
            survey(points.points(), 0.01, (axis,))
        assert refused.value.quantity == "velocity"
    finally:
        points.close()


@pytest.mark.looptime
async def test_the_motors_follow_the_path_within_a_step_a_cycle_later(stack: Stack) -> None:
    axes = await stack.enabled()
    syncs: list[float] = []
    worst = 0.0

    def on_frame(_: str, frame: object) -> None:
        nonlocal worst
        if getattr(frame, "cob_id", None) == 0x080:
            now = asyncio.get_running_loop().time()
            if syncs:
                time = (len(syncs) - 1) * PERIOD
                if time <= SECONDS:
                    wanted = [way(time) for way in WAYS]
                    worst = max(worst, *(abs(a - b) for a, b in zip(motors(stack), wanted, strict=True)))
            syncs.append(now)

    stack.wire.tap(on_frame)
    trajectory = follow(axes, points_of(*WAYS))
    assert await trajectory.wait(30), "it ends"
    assert trajectory.error is None
    assert trajectory.state is MotionState.SUCCEEDED
    # At each SYNC the motor is where the path was a cycle before: rounding, and the polynomial's own error.
    assert worst <= 1.0
    assert trajectory.result is not None
    assert trajectory.result["cycles"] == 201 == len(syncs)
    assert trajectory.result["under_runs"] == 0
    gaps = [b - a for a, b in itertools.pairwise(syncs)]
    assert max(gaps) - min(gaps) < 0.0005
    assert all(axis.status.mode is Mode.NO_MODE for axis in axes)
    assert all(axis.status.state is PowerState.OPERATION_ENABLED for axis in axes)
    assert all(axis.errand is None and axis.motion is None for axis in axes)
    move = axes[0].move_to(MoveRequest(target=500))
    assert await move.wait(20)
    assert move.state is MotionState.SUCCEEDED


@pytest.mark.looptime
async def test_a_stop_of_one_axis_brings_all_to_rest_on_the_path_within_their_decelerations(
    stack: Stack,
) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.5)  # the fastest point
    track: list[list[float]] = []
    stack.wire.tap(lambda _, f: track.append(motors(stack)) if f.cob_id == 0x080 else None)
    await axes[1].stop("a test")
    assert trajectory.state is MotionState.CANCELLED
    await asyncio.gather(*(axis.stands() for axis in axes))
    for index, axis in enumerate(axes):
        own = [[places[index]] for places in track]
        assert max(falls_of(own)) <= axis.config.deceleration + ROUNDING
    # On the path: the axes are where one and the same time of the path has them.
    end = motors(stack)
    time = math.acos(1 - 2 * end[0] / 20_000) * SECONDS / (2 * math.pi)
    assert [round(way(time)) for way in WAYS] == pytest.approx(end, abs=3)
    assert 0.5 < time < 0.8
    assert all(axis.status.mode is Mode.NO_MODE and not axis.status.moving for axis in axes)
    assert all(axis.status.state is PowerState.OPERATION_ENABLED for axis in axes)


@pytest.mark.looptime
async def test_a_stop_on_a_curve_steeper_than_the_deceleration_begins_at_once_and_is_no_steeper() -> None:
    """A circle that `max_acceleration` allows, of twice the axes' deceleration, at full speed after 1 s."""
    radius, turn, rate = 4000, 5.0, 50_000  # 20,000 steps/s, 100,000 steps/s2

    def angle(t: float) -> float:
        return turn * (t * t / 2 if t < 1 else t - 0.5 if t < 7 else 7 - (8 - t) ** 2 / 2)

    ways = (lambda t: radius * (math.cos(angle(t)) - 1), lambda t: radius * math.sin(angle(t)))
    axes = tuple(
        AxisConfig(name=n, velocity=20_000, acceleration=rate, deceleration=rate, max_acceleration=110_000)
        for n in "xyz"
    )
    async with stack_of(1, axes=axes) as stack:
        trajectory = follow((await stack.enabled())[:2], points_of(*ways, seconds=8))
        await until(lambda: trajectory.started is not None)
        await asyncio.sleep(2)
        track: list[list[float]] = []
        stack.wire.tap(lambda _, f: track.append(motors(stack)) if f.cob_id == 0x080 else None)
        begun = asyncio.get_running_loop().time()
        await stack.network.axis(trajectory.axes[0]).stop("a test")
        assert asyncio.get_running_loop().time() - begun < 20_000 / rate + 0.4
        assert max(falls_of(track)) <= 2 * rate * 1.01 + ROUNDING
        x, y = motors(stack)[:2]
        assert math.hypot(x + radius, y) == pytest.approx(radius, abs=15), "it stands on the path"


@pytest.mark.looptime
async def test_a_fault_of_one_axis_stops_all(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.4)
    stack.modules[1].apply(lambda module, now: module.axes[2].short("a", now))
    assert await trajectory.wait(10)
    assert trajectory.state is MotionState.FAILED
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert axes[2].status.state is PowerState.FAULT
    for axis in axes[:2]:
        assert axis.status.state is PowerState.OPERATION_ENABLED
        assert not axis.status.moving


@pytest.mark.looptime
async def test_an_emergency_that_comes_behind_the_fault_explains_it_all_the_same(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.4)
    stack.wire.faults.delay(cob_id(emcy(1)), 0.09)
    stack.modules[1].apply(lambda module, now: module.axes[2].short("a", now))
    assert await trajectory.wait(10)
    assert isinstance(trajectory.error, AxisFault)
    assert "2312" in trajectory.error.message
    await asyncio.gather(*(axis.stands() for axis in axes))


@pytest.mark.looptime
async def test_a_quick_stop_of_one_axis_silences_the_sender_and_halts_the_others(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.5)
    syncs: list[float] = []
    stack.wire.tap(lambda _, f: syncs.append(f.timestamp) if f.cob_id == 0x080 else None)
    await axes[0].quick_stop()
    assert trajectory.state is MotionState.CANCELLED
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED
    assert all(axis.status.state is PowerState.OPERATION_ENABLED for axis in axes[1:])
    await until(lambda: not axes[0].backbone.sync.obstacles())
    await asyncio.sleep(0.01)
    assert len(syncs) == 1, "only the one that makes harmless what waited in the module"
    places = motors(stack)
    stack.axes[0].backbone.sync.send()
    await asyncio.sleep(1)
    assert motors(stack) == places
    assert axes[0].status.state is PowerState.SWITCH_ON_DISABLED


def falls_of(track: list[list[float]]) -> list[float]:
    """By how much the speed of any axis changed from cycle to cycle, steps/s2."""
    speeds = [[(b - a) / PERIOD for a, b in zip(*two, strict=True)] for two in itertools.pairwise(track)]
    return [abs(b - a) / PERIOD for two in itertools.pairwise(speeds) for a, b in zip(*two, strict=True)]


ROUNDING = 3 / PERIOD**2
"""What rounding to steps can make of such a change."""


@pytest.mark.looptime
@pytest.mark.parametrize("at", [0.5, 1.2, 2.05])
async def test_rows_that_come_too_late_end_in_a_ramp_not_in_a_jerk(at: float) -> None:
    """From 2 s to 3 s the path is a corner: x brakes and y speeds up, as hard as both may."""
    rate = 20_000
    bends = {0.0: (1, 0), 1.0: (0, 0), 2.0: (-1, 1), 3.0: (0, 0), 8.0: (0, -1)}
    here, speed, bend = [0.0, 0.0], [0.0, 0.0], (0, 0)
    points = PointFile(2)
    for number in range(91):
        bend = bends.get(number / 10, bend)
        points.add(number / 10, here, speed)
        here = [p + v / 10 + b * rate / 200 for p, v, b in zip(here, speed, bend, strict=True)]
        speed = [v + b * rate / 10 for v, b in zip(speed, bend, strict=True)]
    axes = tuple(AxisConfig(name=n, velocity=rate, acceleration=rate, deceleration=rate) for n in "xyz")
    async with stack_of(1, axes=axes) as stack:
        trajectory = follow((await stack.enabled())[:2], points)
        sender, last = trajectory._sender, round(at / PERIOD) + trajectory._plan.reserve
        feed, given = sender.feed, 0

        def late(rows: Sequence[Row]) -> None:
            nonlocal given
            feed(rows[: max(0, last - given)])
            given += len(rows)

        sender.feed = late
        track: list[list[float]] = []
        stack.wire.tap(lambda _, f: track.append(motors(stack)) if f.cob_id == 0x080 else None)
        assert await trajectory.wait(30)
        assert trajectory.state is MotionState.FAILED
        assert isinstance(trajectory.error, MotionFailed)
        assert "under-run" in trajectory.error.message
        assert trajectory.result is not None
        assert trajectory.result["under_runs"] == 1
        await asyncio.gather(*(stack.network.axis(each).stands() for each in trajectory.axes))
        assert max(falls_of([*track, motors(stack)])) <= rate + ROUNDING


@pytest.mark.looptime
async def test_a_sender_that_is_gone_leaves_the_stop_to_the_drives(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.5)
    trajectory._sender.cut()
    assert await trajectory.wait(10)
    assert trajectory.state is MotionState.FAILED
    assert "sender" in str(trajectory.error)
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert all(not a.status.moving and a.status.state is PowerState.OPERATION_ENABLED for a in axes)


@pytest.mark.looptime
@pytest.mark.parametrize("seconds", [0.0, 0.5, 1.9])
async def test_a_sender_that_hangs_is_cut_and_the_drives_are_halted(stack: Stack, seconds: float) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(seconds)
    sender = trajectory._sender
    assert isinstance(sender, LoopSender)
    assert sender._timer is not None
    sender._timer.cancel()  # it sends no cycle more and says nothing, as a process that was sent SIGSTOP
    assert await trajectory.wait(2)
    assert trajectory.state is MotionState.FAILED
    assert "sent nothing any more" in str(trajectory.error)
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert all(not a.status.moving and a.status.state is PowerState.OPERATION_ENABLED for a in axes)
    assert all(axis.status.mode is Mode.NO_MODE for axis in axes)
    await until(lambda: not axes[0].backbone.sync.obstacles())


@pytest.mark.looptime
async def test_a_bus_that_is_gone_ends_it_and_nothing_goes_on_when_it_is_back(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.3)
    stack.port.unplug()
    assert await trajectory.wait(10)
    assert trajectory.state is MotionState.FAILED
    await asyncio.sleep(2)
    places = motors(stack)
    stack.port.plug()
    await stack.ready()
    await asyncio.sleep(1)
    assert motors(stack) == places
    await until(lambda: not axes[0].backbone.sync.obstacles(), 60)


@pytest.mark.looptime
async def test_a_row_that_waits_behind_a_short_gap_of_the_bus_is_made_harmless_before_any_sync(
    stack: Stack,
) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.state is MotionState.RUNNING)
    await asyncio.sleep(0.6)
    stack.port.unplug()
    await asyncio.sleep(0.2)  # less than 1016h: the drives stay enabled, and in csp
    sync = axes[0].backbone.sync
    assert trajectory.done
    await until(lambda: sync.user is None, 60)
    assert {obstacle.code for obstacle in sync.obstacles()} == {"set_point_waits"}
    stack.port.plug()
    await until(lambda: not sync.obstacles(), 60)
    await asyncio.sleep(1)
    places = motors(stack)
    stranger = stack.wire.port("stranger")
    await stranger.open()
    stranger.send(Frame(0x080, b""))
    await asyncio.sleep(1)
    assert motors(stack) == places
    await stranger.close()


@pytest.mark.looptime
async def test_a_row_that_waits_in_a_node_out_of_reach_is_owed_until_the_node_is_back(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.state is MotionState.RUNNING)
    await asyncio.sleep(0.5)
    stack.wire.faults.drop(lambda frame: frame.cob_id != 0x77F)  # its stub is cut; our heartbeat gets through
    await until(lambda: stack.node.state is NodeState.LOST)
    sync = axes[0].backbone.sync
    assert trajectory.state is MotionState.FAILED
    await until(lambda: sync.user is None, 60)
    assert {obstacle.code for obstacle in sync.obstacles()} == {"set_point_waits"}
    places = motors(stack)
    stack.wire.faults.clear()
    await stack.ready()
    await until(lambda: not sync.obstacles())
    stack.wire.inject(Frame(0x080, b""))
    await asyncio.sleep(1)
    assert motors(stack) == places
    assert all(axis.status.state is PowerState.OPERATION_ENABLED for axis in axes), "it did not fault instead"


@pytest.mark.looptime
async def test_lost_set_points_and_syncs_are_made_good_by_the_next(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.3)
    stack.wire.faults.drop(lambda frame: frame.cob_id == 0x080, 1)
    await asyncio.sleep(0.3)
    stack.wire.faults.drop(lambda frame: frame.cob_id == axes[0].pdos.synchronous.cob_id, 1)
    assert await trajectory.wait(30)
    assert trajectory.state is MotionState.SUCCEEDED
    assert motors(stack) == pytest.approx([way(SECONDS) for way in WAYS], abs=1)


@pytest.mark.looptime
async def test_what_can_not_begin_sends_nothing(stack: Stack) -> None:
    axes = await stack.enabled()
    first = follow(axes[:2], points_of(*WAYS[:2]))
    with pytest.raises(AxisBusy):
        follow(axes[:1], points_of(WAYS[0]))
    with pytest.raises(NotReady, match="SYNC"):
        follow(axes[2:], points_of(WAYS[2]))
    await first.cancel()
    assert first.state is MotionState.CANCELLED
    await until(lambda: not axes[0].backbone.sync.obstacles())
    again = follow(axes[2:], points_of(WAYS[2]))
    assert await again.wait(30)
    assert again.state is MotionState.SUCCEEDED


@pytest.mark.looptime
async def test_a_stop_before_it_has_begun_leaves_every_axis_standing(stack: Stack) -> None:
    axes = await stack.enabled()
    for seconds in (0.0, 0.001, 0.01, 0.03):
        trajectory = follow(axes, points_of(*WAYS))
        await asyncio.sleep(seconds)
        await stack.network.stop_all("a test")
        assert trajectory.state is MotionState.CANCELLED
        await until(lambda: not axes[0].backbone.sync.obstacles())
        stack.network.reset_stop()
        assert all(axis.status.mode is Mode.NO_MODE for axis in axes)
        assert motors(stack) == [0, 0, 0]


@pytest.mark.looptime
async def test_a_following_error_of_one_axis_stops_all(stack: Stack, monkeypatch: pytest.MonkeyPatch) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.4)
    control = stack.modules[1].module.axes[1].modes[Mode.CYCLIC_SYNC_POSITION]
    monkeypatch.setattr(type(control), "bits", lambda self, now: (3 if self is control else 1) << 12)
    assert await trajectory.wait(10)
    assert trajectory.state is MotionState.FAILED
    assert "bit 13" in str(trajectory.error)
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert all(not a.status.moving and a.status.state is PowerState.OPERATION_ENABLED for a in axes)


@pytest.mark.looptime
@pytest.mark.parametrize("at", [0.005, 0.01, 2.06])
async def test_a_fault_at_either_end_is_no_success(stack: Stack, at: float) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await asyncio.sleep(at)
    stack.modules[1].apply(lambda module, now: module.axes[2].short("a", now))
    assert await trajectory.wait(10)
    assert trajectory.state is MotionState.FAILED
    await asyncio.gather(*(axis.stands() for axis in axes))
    assert axes[2].status.state is PowerState.FAULT
    assert not any(axis.status.moving for axis in axes)
    await until(lambda: not axes[0].backbone.sync.obstacles())


@pytest.mark.looptime
@pytest.mark.parametrize("what", ["silent", "restarts"])
async def test_a_node_that_goes_brings_the_axes_of_the_others_to_rest_on_the_path(what: str) -> None:
    async with stack_of(1, 2) as stack:
        await stack.ready()
        stays, goes = stack.network.node(1).axes[0], stack.network.node(2).axes[0]
        await asyncio.gather(stays.enable(), goes.enable())
        trajectory = follow((stays, goes), points_of(*WAYS[:2]))
        await until(lambda: trajectory.started is not None)
        await asyncio.sleep(0.3)
        if what == "silent":
            stack.modules[2].faults.silent = True
        else:
            stack.modules[2].power_cycle()
        assert await trajectory.wait(10)
        assert isinstance(trajectory.error, NodeAway)
        motor = stack.modules[1].module.axes[0].motor
        loop = asyncio.get_running_loop()
        await until(lambda: not stack.modules[1].module.axes[0].moving, 5)
        place = motor.position(loop.time())
        await asyncio.sleep(2)
        assert motor.position(loop.time()) == place
        assert stays.status.state is PowerState.OPERATION_ENABLED
        stack.modules[2].faults.clear()  # nobody can tell what a node that doesn't come back has waiting
        await until(lambda: not stays.backbone.sync.obstacles(), 60)


@pytest.mark.looptime
async def test_at_an_orderly_end_the_axes_stand_before_our_heartbeat_ends(stack: Stack) -> None:
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.5)
    moved: list[bool] = []
    module = stack.modules[1].module
    stack.wire.tap(
        lambda _, f: moved.append(any(a.moving for a in module.axes)) if f.cob_id == 0x77F else None
    )
    await stack.network.close()
    assert trajectory.state is MotionState.CANCELLED
    assert (moved[0], moved[-1]) == (True, False)
    assert all(axis.state is PowerState.SWITCH_ON_DISABLED for axis in module.axes)


@pytest.mark.looptime
@pytest.mark.parametrize("end", ["played", "stop", "quick_stop", "disable"])
async def test_after_a_trajectory_a_halt_goes_out_at_once_again(stack: Stack, end: str) -> None:
    """A stop sends it before anything is awaited, whatever led the axis before."""
    axes = await stack.enabled()
    trajectory = follow(axes, points_of(*WAYS))
    await until(lambda: trajectory.started is not None)
    await asyncio.sleep(0.5)
    if end != "played":
        await getattr(axes[1], end)()
    assert await trajectory.wait(30)
    await asyncio.gather(*(axis.stands() for axis in axes))
    await stack.enabled()
    for axis in axes:
        axis.run_at(VelocityRequest(20_000))
    await asyncio.sleep(0.5)
    sent = stack.network.counters.sent
    stack.network.latch_stop("a test")
    assert stack.network.counters.sent == sent + len(axes)
    assert all(axis.tools.drive.halted for axis in axes)
