"""An axis's settings on the way into the module: at boot-up, and while the service runs."""

from __future__ import annotations

from fractions import Fraction

from stack_kit import stack_of

from drivers.cia301.objects import Address
from drivers.master import AxisConfig
from drivers.master.gearing import Gearing


async def test_the_resolution_of_a_geared_axis_is_written_at_boot_up_and_no_other() -> None:
    geared = AxisConfig("y", unit="mm", gearing=Gearing(400, 16, Fraction(3), Fraction(5000)))
    async with stack_of(1, axes=(AxisConfig("x"), geared, AxisConfig("z"))) as stack:
        await stack.ready()
        held = {
            (index, sub): await stack.node.read(Address(index, sub))
            for index, sub in ((0x2000, 0), (0x2001, 0), (0x2200, 0), (0x2201, 0))
        }
        assert held == {(0x2000, 0): 8, (0x2001, 0): 200, (0x2200, 0): 4, (0x2201, 0): 400}
        changed = [c.address for step in stack.node.status().boot for c in step.changes]
        assert Address(0x2200, 0) in changed
        assert Address(0x2000, 0) not in changed
