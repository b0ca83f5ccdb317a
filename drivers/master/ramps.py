"""How long a ramp takes: for the deadlines of motions and stops.

The trapezoid of manual §1.5 with V1 = V2 = 0.
"""

from __future__ import annotations

import math


def move_duration(distance: float, velocity: float, acceleration: float, deceleration: float) -> float:
    """Seconds for `distance` steps from standstill to standstill; rates positive, steps/s and steps/s2."""
    distance = abs(distance)
    ramps = velocity * velocity * (1 / acceleration + 1 / deceleration) / 2
    if distance >= ramps:
        return velocity / acceleration + velocity / deceleration + (distance - ramps) / velocity
    peak = math.sqrt(2 * distance / (1 / acceleration + 1 / deceleration))
    return peak / acceleration + peak / deceleration


def velocity_change_duration(start: float, end: float, acceleration: float) -> float:
    """Seconds from one signed velocity to another, steps/s and steps/s2."""
    return abs(end - start) / acceleration
