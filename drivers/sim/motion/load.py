"""How hard the motor works: StallGuard2, StallGuard4, PWM scale.

The manual says only that the value falls linearly with the load, reaches 0 where the motor stalls, and
depends on the speed (§1.4.1). The curve here has that shape; its numbers are unverified on hardware.
"""

from __future__ import annotations

import math
from typing import Final

_SATURATION: Final = 51_200.0
"""Speed in microsteps/s at which the value has half its height: one turn a second of a usual motor."""
_SG2_TOP: Final = 1023
_SG4_TOP: Final = 511
_THRESHOLD_STEP: Final = 8
"""By how much one step of 209Eh shifts the value."""


def stallguard2(load: float, speed: float, threshold: int) -> int:
    """2101h for a load (share of the torque), a speed (microsteps/s) and 209Eh. 0 at standstill."""
    if not speed:
        return 0
    return min(max(int(_height(load, speed) * _SG2_TOP) + threshold * _THRESHOLD_STEP, 0), _SG2_TOP)


def stallguard4(load: float, speed: float) -> int:
    """210Ah for a load and a speed. 0 at standstill."""
    return min(max(int(_height(load, speed) * _SG4_TOP), 0), _SG4_TOP) if speed else 0


def stall_speed(load: float, threshold: int) -> float:
    """The speed up to which `stallguard2` is 0: infinite where the motor can't carry the load."""
    torque = 1.0 - min(load, 1.0)
    needed = 1 - threshold * _THRESHOLD_STEP
    if needed <= 0:
        return 0.0
    share = needed / (_SG2_TOP * torque) if torque else math.inf
    return _SATURATION * share / (1.0 - share) if share < 1.0 else math.inf


def stall_speed4(load: float, threshold: int) -> float:
    """The speed below which `stallguard4` is less than 20A8h; 0 where that is 0."""
    torque = 1.0 - min(load, 1.0)
    share = threshold / (_SG4_TOP * torque) if torque else math.inf if threshold else 0.0
    return _SATURATION * share / (1.0 - share) if share < 1.0 else math.inf


def pwm_scale(speed: float, powered: bool) -> int:
    """2121h: rises with the speed, 0 without current."""
    return min(int(32 + 223 * abs(speed) / (abs(speed) + 4 * _SATURATION)), 255) if powered else 0


def _height(load: float, speed: float) -> float:
    fast = abs(speed)
    return (1.0 - min(load, 1.0)) * fast / (fast + _SATURATION)
