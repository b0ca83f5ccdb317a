"""Inputs and outputs of a module."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DigitalInput:
    """A digital input."""

    number: int
    name: str
    on: bool


@dataclass(frozen=True, slots=True)
class AnalogInput:
    """An analog input."""

    number: int
    name: str
    raw: int
    """As the converter has it."""
    volts: float | None
    """None unless the service's settings say what the highest value stands for."""


@dataclass(frozen=True, slots=True)
class Switch:
    """A limit or home switch of an axis; on: pressed."""

    axis: int
    name: str
    on: bool
    age_s: float | None
    stale: bool


@dataclass(frozen=True, slots=True)
class Inputs:
    """All inputs of a node."""

    digital: tuple[DigitalInput, ...]
    analog: tuple[AnalogInput, ...]
    switches: tuple[Switch, ...]
    age_s: float
    """Seconds since the digital and analog inputs were asked for, when the service answered."""


@dataclass(frozen=True, slots=True)
class Output:
    """A digital output as the module holds it."""

    number: int
    name: str
    on: bool
    usable: bool
    """Whether the pin is an output, so that it can be switched."""
    push_pull: bool


@dataclass(frozen=True, slots=True)
class Outputs:
    """All outputs of a node."""

    outputs: tuple[Output, ...]
