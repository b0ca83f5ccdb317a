"""Indices of the drive's objects for axis 0; `drivers.devices.profile.AxisLayout` adds an axis's offset."""

from __future__ import annotations

from typing import Final

ABORT_CONNECTION_OPTION: Final = 0x6007
"""CiA 402 has it; the TMCM-3216 does not."""
ERROR_CODE: Final = 0x603F
"""CiA 402 has it; the TMCM-3216 does not."""
CONTROLWORD: Final = 0x6040
STATUSWORD: Final = 0x6041
QUICK_STOP_OPTION: Final = 0x605A
SHUTDOWN_OPTION: Final = 0x605B
DISABLE_OPTION: Final = 0x605C
HALT_OPTION: Final = 0x605D
FAULT_REACTION_OPTION: Final = 0x605E
MODE: Final = 0x6060
MODE_DISPLAY: Final = 0x6061
POSITION_DEMAND: Final = 0x6062
POSITION_INTERNAL: Final = 0x6063
POSITION: Final = 0x6064
FOLLOWING_ERROR_WINDOW: Final = 0x6065
POSITION_WINDOW: Final = 0x6067
POSITION_WINDOW_TIME: Final = 0x6068
SENSOR_SELECTION: Final = 0x606A
VELOCITY: Final = 0x606C
TARGET_TORQUE: Final = 0x6071
TORQUE: Final = 0x6077
TARGET_POSITION: Final = 0x607A
HOME_OFFSET: Final = 0x607C
SOFTWARE_LIMIT: Final = 0x607D
PROFILE_VELOCITY: Final = 0x6081
END_VELOCITY: Final = 0x6082
PROFILE_ACCELERATION: Final = 0x6083
PROFILE_DECELERATION: Final = 0x6084
QUICK_STOP_DECELERATION: Final = 0x6085
ENCODER_RESOLUTION: Final = 0x608F
HOMING_METHOD: Final = 0x6098
HOMING_SPEEDS: Final = 0x6099
HOMING_ACCELERATION: Final = 0x609A
POSITION_OFFSET: Final = 0x60B0
VELOCITY_OFFSET: Final = 0x60B1
INTERPOLATION_PERIOD: Final = 0x60C2
POSITIONING_OPTION: Final = 0x60F2
DIGITAL_INPUTS: Final = 0x60FD
TARGET_VELOCITY: Final = 0x60FF
SUPPORTED_MODES: Final = 0x6502
SINGLE_DEVICE_TYPE: Final = 0x67FF


class DigitalInput:
    """Bits of 60FDh as CiA 402 has them.

    The manual (§5.1.10) says only that each bit is one input: unverified on hardware.
    """

    NEGATIVE_LIMIT: Final = 1 << 0
    POSITIVE_LIMIT: Final = 1 << 1
    HOME_SWITCH: Final = 1 << 2
    INTERLOCK: Final = 1 << 3
