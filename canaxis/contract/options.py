"""What a command may be given besides what it must: the keyword arguments of the client's methods."""

from __future__ import annotations

from typing import Literal, NotRequired, TypedDict


class Keyed(TypedDict, total=False):
    """What every command that takes time may be given."""

    key: str
    """An Idempotency-Key of your own: sent again with it, even by another run, it is carried out once."""


OnBusy = Literal["reject", "replace", "queue"]


class MovingOptions(Keyed, total=False):
    """What every moving command may be given."""

    on_busy: OnBusy
    """If something else holds the axis: `reject` (the default) refuses, `replace` cancels what runs and what
    waits, `queue` begins once everything before it has succeeded.
    """


class MoveOptions(MovingOptions, total=False):
    """What a move may be given besides target and unit; what is left out comes from the axis's settings."""

    relative: bool
    """Whether the target is a distance from here."""
    velocity: float
    """unit/s"""
    acceleration: float
    """unit/s2"""
    deceleration: float
    """unit/s2"""


class GoOptions(MovingOptions, total=False):
    """What going to a named position may be given."""

    unit: str
    """Of the speed and the accelerations; needed with any of them."""
    velocity: float
    """unit/s"""
    acceleration: float
    """unit/s2"""
    deceleration: float
    """unit/s2"""


class SetPositionOptions(Keyed, total=False):
    """What saying where an axis stands may be given."""

    shift_limits: bool
    """Needed where the axis was homed and has travel limits: they move with its positions."""


class TeachOptions(TypedDict, total=False):
    """What is taught; nothing: where the axis stands."""

    position: float
    """In `unit`."""
    unit: str
    unreferenced: bool
    """Take it, and let the axis go there, though it was not homed."""


class WaitOptions(Keyed, total=False):
    """What waiting for an input may be given."""

    timeout_s: float
    """Seconds it may take; 30 if left out."""


class AnalogOptions(WaitOptions, total=False):
    """What an analog input is waited for to be: one of the two."""

    above: float
    """In `unit`."""
    below: float
    """In `unit`."""


class Target(TypedDict):
    """Where one axis of a coordinated move is to go."""

    node: int | str
    axis: int | str
    target: float
    unit: str
    relative: NotRequired[bool]
    """Whether the target is a distance from here."""
    velocity: NotRequired[float]
    """unit/s, at most"""
    acceleration: NotRequired[float]
    """unit/s2, at most"""
    deceleration: NotRequired[float]
    """unit/s2, at most"""


class TogetherOptions(Keyed, total=False):
    """What a coordinated move may be given besides its targets."""

    duration_s: float
    """Seconds that it is to take at least."""
    on_busy: Literal["reject", "replace"]
    """What becomes of it while an axis is busy: `replace` stops that first."""


class VelocityOptions(MovingOptions, total=False):
    """What running at a speed may be given besides speed and unit."""

    acceleration: float
    """unit/s2, up and down"""
    duration_s: float
    """Seconds at the speed; then it ramps down. At most one of the three ends."""
    travel: float
    """Distance in unit, from standstill to standstill"""
    lease: bool
    """Whether it ends with the lease that it is sent under"""


class HomeOptions(MovingOptions, total=False):
    """What homing may be given; what is left out comes from the axis's settings."""

    method: int
    """Homing method (6098h)."""
    unit: str
    """Of the speeds and the acceleration; needed with any of them."""
    fast: float
    """Speed while seeking the switch, unit/s"""
    slow: float
    """Speed while seeking the edge, unit/s"""
    acceleration: float
    """unit/s2"""
    timeout_s: float
    """Seconds it may take."""
