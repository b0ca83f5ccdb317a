"""The general-purpose inputs and outputs of a node: 2702h, 2703h, 270Eh, 2711h (manual §4.2.60 ff.).

How many a model has, and which bit each is, its profile says. Everything is read and written by SDO; who asks
often shares the transfers of the others. The manual gives the converter of the analog inputs no scale: volts
are known only where the node's configuration says what its highest value stands for.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.cia301.objects import Address
from drivers.devices.meanings import Meaning
from drivers.errors import ConfigurationRefused, NotReady, Obstacle, StopLatched, UnknownTerminal
from drivers.master.link.node_link import NodeLink
from drivers.master.sdo.client import Priority
from drivers.obstacles import NOT_AN_OUTPUT, STOP_LATCHED_FOR_OUTPUTS, USED_BY_BRAKE

DIGITAL_INPUTS = Address(0x2702)
OUTPUT_LEVELS = Address(0x2703, 1)
OUTPUT_MASK = Address(0x2703, 2)
ANALOG_INPUTS = 0x270E
IO_MODE = Address(0x2711)
BRAKE_CURRENTS = 0x200C
"""Base index; sub 1 is fed to apply the brake, sub 2 to release it."""


@dataclass(frozen=True, slots=True)
class DigitalLevel:
    """A digital input at one moment."""

    number: int
    name: str
    on: bool


@dataclass(frozen=True, slots=True)
class AnalogLevel:
    """An analog input at one moment."""

    number: int
    name: str
    raw: int
    """As the converter has it, 0 to the highest value."""
    volts: float | None
    """None where the configuration doesn't say what the highest value stands for."""


@dataclass(frozen=True, slots=True)
class Output:
    """A digital output as the module holds it."""

    number: int
    name: str
    on: bool
    """Whether the module drives it: its bit is set, released by the mask, and the pin is an output."""
    usable: bool
    """Whether the pin is an output (2711h)."""
    push_pull: bool
    """Whether it drives both levels; otherwise the high side only (2711h)."""


class NodeIo:
    """What a node has of them.

    Raises `NodeAway` while the node is not operational, `SdoError`, `BusError`.
    """

    def __init__(self, node: NodeLink, axes: Sequence[str]) -> None:
        """`axes`: their names, by number."""
        self._node = node
        self._axes = axes
        profile = node.profile
        self.digital: tuple[Meaning, ...] = profile.bits(DIGITAL_INPUTS)
        """A row for each digital input, by number."""
        self.outputs: tuple[Meaning, ...] = profile.bits(OUTPUT_LEVELS)
        """A row for each digital output, by number."""
        modes = {row.name: row.key for row in profile.bits(IO_MODE)}
        self._directions = tuple(modes.get(f"output_mode_{n}") for n in range(len(self.outputs)))
        self._stages = tuple(modes.get(f"push_pull_{n}") for n in range(len(self.outputs)))
        self.analog = tuple(
            spec for sub in range(1, 255) if (spec := profile.find(Address(ANALOG_INPUTS, sub))) is not None
        )
        """The object of each analog input, by number."""
        self._writing = asyncio.Lock()

    # --- reading ---

    async def digital_levels(self) -> tuple[DigitalLevel, ...]:
        """Every digital input; of a pin in output mode, what the module shows there."""
        self._node.require_operational()
        if not self.digital:
            return ()
        bits = _number(await self._node.read(DIGITAL_INPUTS))
        return tuple(
            DigitalLevel(number, row.title, bool(bits >> row.key & 1))
            for number, row in enumerate(self.digital)
        )

    async def analog_levels(self) -> tuple[AnalogLevel, ...]:
        """Every analog input."""
        self._node.require_operational()
        return tuple(
            [
                self.analog_level(number, _number(await self._node.read(spec.address)))
                for number, spec in enumerate(self.analog)
            ]
        )

    def analog_level(self, number: int, raw: int) -> AnalogLevel:
        """What a value of an analog input stands for."""
        scale = self.volts_per_count
        return AnalogLevel(number, f"AIN{number}", raw, None if scale is None else raw * scale)

    @property
    def volts_per_count(self) -> float | None:
        """The scale of the analog inputs, where the configuration gives it."""
        volts = self._node.config.analog_full_scale
        highest = self.analog[0].maximum if self.analog else None
        return None if volts is None or not highest else volts / highest

    async def output_levels(self) -> tuple[Output, ...]:
        """Every digital output."""
        self._node.require_operational()
        if not self.outputs:
            return ()
        levels = _number(await self._node.read(OUTPUT_LEVELS))
        mask = _number(await self._node.read(OUTPUT_MASK))
        mode = _number(await self._node.read(IO_MODE))
        return tuple(self._output(number, levels & mask, mode) for number in range(len(self.outputs)))

    # --- writing ---

    def find_output(self, ref: int | str) -> int:
        """The number of an output by number or name. Raises `UnknownTerminal`."""
        for number, row in enumerate(self.outputs):
            if ref in (number, str(number), row.title, row.name):
                return number
        known = ", ".join(row.title for row in self.outputs) or "none"
        raise UnknownTerminal(
            f"Node {self._node.name} has no output {ref!r}.",
            hint=f"It has {known}.",
            node=self._node.node_id,
        )

    async def switch(self, number: int, *, on: bool) -> Output:
        """Switch one output, and read back that the module holds it. The others keep their levels.

        Raises `StopLatched` for `on` while everything is stopped (what an output moves is not known here),
        `NotReady` where the pin is an input, or where a brake may hang on it: a module that feeds the brake
        of any axis (200Ch) gives its outputs to that (§4.2.61), and which output is whose the manual doesn't
        say. Unverified on hardware.
        """
        self._node.require_operational()
        if on:
            self._require_no_latch(number)
        async with self._writing:
            await self._require_free(number)
            bit = 1 << self.outputs[number].key
            levels = await self._held(OUTPUT_LEVELS)
            mask = await self._held(OUTPUT_MASK)
            if on:
                self._require_no_latch(number)  # it may have come meanwhile
            await self._write(OUTPUT_LEVELS, levels | bit if on else levels & ~bit)
            if not mask & bit:
                await self._write(OUTPUT_MASK, mask | bit)
            levels, mask = await self._held(OUTPUT_LEVELS), await self._held(OUTPUT_MASK)
            if bool(levels & bit) is not on or not mask & bit:
                raise ConfigurationRefused(
                    f"Node {self._node.name} took output {self.outputs[number].title} "
                    f"{'on' if on else 'off'}, but holds {levels:08X}h with the mask {mask:08X}h.",
                    hint="Look for a second master that writes 2703h.",
                    node=self._node.node_id,
                    index=OUTPUT_LEVELS.index,
                    sub=OUTPUT_LEVELS.sub,
                )
            return self._output(number, levels & mask, await self._held(IO_MODE))

    # --- inside ---

    def _output(self, number: int, driven: int, mode: int) -> Output:
        row = self.outputs[number]
        usable = _is_set(mode, self._directions[number])
        return Output(
            number,
            row.title,
            usable and bool(driven >> row.key & 1),
            usable,
            _is_set(mode, self._stages[number]),
        )

    async def _held(self, address: Address) -> int:
        return await self._node.objects.read_int(address, priority=Priority.CONFIGURE)

    async def _write(self, address: Address, value: int) -> None:
        await self._node.objects.write(address, value, priority=Priority.CONFIGURE)

    def _require_no_latch(self, number: int) -> None:
        latch = self._node.backbone.stop_latched
        if latch is not None:
            obstacle = STOP_LATCHED_FOR_OUTPUTS.found(f"Everything was stopped: {latch.reason}")
            raise StopLatched(
                f"Output {self.outputs[number].title} is not switched on now: {obstacle.message}",
                obstacles=(obstacle,),
                node=self._node.node_id,
            )

    async def _require_free(self, number: int) -> None:
        name = self.outputs[number].title
        found: list[Obstacle] = []
        if not _is_set(await self._held(IO_MODE), self._directions[number]):
            found.append(NOT_AN_OUTPUT.found(f"The pin of {name} is an input (2711h).", bit=number))
        for axis, axis_name in enumerate(self._axes):
            if self._node.objects.has(BRAKE_CURRENTS, 1, axis):
                currents = [
                    await self._held(self._node.objects.address(BRAKE_CURRENTS, sub, axis)) for sub in (1, 2)
                ]
                if any(currents):
                    found.append(
                        USED_BY_BRAKE.found(
                            f"The module drives the brake of axis {axis_name} with its outputs (200Ch)."
                        )
                    )
        if found:
            raise NotReady(
                f"Output {name} can't be switched: {' '.join(o.message for o in found)}",
                hint=" ".join(o.remedy for o in found),
                obstacles=tuple(found),
                node=self._node.node_id,
            )


def _number(value: object) -> int:
    assert isinstance(value, int), "the profile gives these objects whole numbers"
    return value


def _is_set(bits: int, key: int | None) -> bool:
    return key is not None and bool(bits >> key & 1)
