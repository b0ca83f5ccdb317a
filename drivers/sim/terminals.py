"""The general-purpose inputs and outputs: 2702h, 2703h, 270Eh, 2711h (manual §4.2.60, 61, 67, 68)."""

from __future__ import annotations

from typing import Final

from drivers.cia301.objects import Address
from drivers.sim.dictionary import ObjectDictionary

DIGITAL_INPUTS: Final = Address(0x2702)
PHYSICAL_OUTPUTS: Final = Address(0x2703, 1)
OUTPUT_MASK: Final = Address(0x2703, 2)
ANALOG_INPUTS: Final = 0x270E
MODE: Final = Address(0x2711)

DIGITAL: Final = 4
ANALOG: Final = 2
ANALOG_MAX: Final = 4095

_FIRST_BIT: Final = 16
_PUSH_PULL: Final = 8


class Terminals:
    """Four digital terminals, each an input or an output, and two analog inputs.

    The manual does not say what 2702h shows of a terminal in output mode: here the level on it, which is
    that of the output, or of whoever pulls it up while a high-side output is off. Nor does it say what
    becomes of an output outside the mask: it is off. Unverified on hardware.
    """

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._applied = [False] * DIGITAL
        self._analog = [0] * ANALOG
        dictionary.attach_live(DIGITAL_INPUTS, self._inputs)
        dictionary.attach_live(Address(ANALOG_INPUTS, 1), lambda: self._analog[0])
        dictionary.attach_live(Address(ANALOG_INPUTS, 2), lambda: self._analog[1])

    def apply(self, terminal: int, level: bool) -> None:
        """Put a level on digital terminal 0..3 from outside."""
        self._applied[terminal] = level

    def set_analog(self, terminal: int, value: int) -> None:
        """Have analog input 0 or 1 read `value`, 0..4095; ValueError otherwise."""
        if not 0 <= value <= ANALOG_MAX:
            raise ValueError(f"an analog input reads 0 to {ANALOG_MAX}, not {value}")
        self._analog[terminal] = value

    def output(self, terminal: int) -> bool:
        """Whether the module drives digital terminal 0..3 high."""
        mode = self._dictionary.stored(MODE)
        driven = self._dictionary.stored(PHYSICAL_OUTPUTS) & self._dictionary.stored(OUTPUT_MASK)
        return bool(mode >> terminal & 1 and driven >> (_FIRST_BIT + terminal) & 1)

    def level(self, terminal: int) -> bool:
        """The level on digital terminal 0..3."""
        mode = self._dictionary.stored(MODE)
        if mode >> terminal & 1 and mode >> (_PUSH_PULL + terminal) & 1:
            return self.output(terminal)
        return self.output(terminal) or self._applied[terminal]

    def _inputs(self) -> int:
        return sum(self.level(terminal) << (_FIRST_BIT + terminal) for terminal in range(DIGITAL))
