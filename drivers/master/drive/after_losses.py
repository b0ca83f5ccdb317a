"""After the module lost messages (8110h, 8140h): does the drive show what it was told last? Read by SDO."""

from __future__ import annotations

from drivers.cia402 import objects
from drivers.cia402.modes import Mode
from drivers.cia402.power import PowerState, decode_state
from drivers.master.drive.tools import AxisTools
from drivers.master.sdo.client import Priority

_TARGETS = {
    Mode.PROFILE_POSITION: objects.TARGET_POSITION,
    Mode.PROFILE_VELOCITY: objects.TARGET_VELOCITY,
}


async def contradiction(tools: AxisTools) -> str:
    """In what the drive contradicts its last command (6041h, 6061h, 607Ah or 60FFh); "" if it fits.

    Raises `SdoError`, `NodeAway` or `BusError` if it can't be asked.
    """
    drive = tools.drive

    async def read(index: int) -> int:
        address = tools.objects.address(index, 0, tools.number)
        return await tools.objects.read_int(address, priority=Priority.CONTROL)

    state = decode_state(await read(objects.STATUSWORD))
    if state is not PowerState.OPERATION_ENABLED:
        return f"it is {state or 'in no known state'}"
    mode = await read(objects.MODE_DISPLAY)
    if mode != drive.mode:
        return f"6061h is {mode} instead of {drive.mode.value}"
    target = _TARGETS.get(drive.mode)
    if target is not None:
        held = await read(target)
        if held != drive.target:
            return f"{target:04X}h is {held} instead of {drive.target}"
    return ""
