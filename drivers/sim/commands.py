"""Commands as a table: each method of a fault panel by its name, with what its parameters take.

The table is made from the methods' annotations, so that a call from Python, a request over HTTP and the
documentation of both go by the same words and limits.
"""

from __future__ import annotations

import functools
import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Concatenate, Final, ParamSpec, Protocol, TypeVar, cast, get_type_hints

from drivers.cia301.cob import MAX_COB_ID
from drivers.errors import BadValue

P = ParamSpec("P")
Panel = TypeVar("Panel")

_HEXADECIMAL: Final = re.compile(r"0x[0-9A-Fa-f]{1,3}")


class Kind(Protocol):
    """What a parameter takes. Used in annotations: ``Annotated[int, Whole("Axis number.", 0)]``."""

    @property
    def description(self) -> str:
        """What the parameter means, as a sentence with its unit."""
        ...

    @property
    def allowed(self) -> str:
        """What it takes, to follow "must be"."""
        ...

    def read(self, value: object) -> object:
        """The value as the method gets it. Raises ValueError if it is not allowed."""
        ...

    def schema(self) -> dict[str, Any]:
        """The JSON Schema of it."""
        ...


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number in a range; `high` None = no upper limit."""

    description: str
    low: int = 0
    high: int | None = None

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return f"a whole number {_range(self.low, self.high)}"

    def read(self, value: object) -> object:
        """See `Kind.read`."""
        if not isinstance(value, int) or isinstance(value, bool) or not _within(value, self.low, self.high):
            raise ValueError
        return value

    def schema(self) -> dict[str, Any]:
        """See `Kind.schema`."""
        return {"type": "integer", **_limits(self.low, self.high)}


@dataclass(frozen=True, slots=True)
class Real:
    """A finite number in a range; `high` None = no upper limit."""

    description: str
    low: float = 0.0
    high: float | None = None

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return f"a number {_range(self.low, self.high)}"

    def read(self, value: object) -> object:
        """See `Kind.read`. A whole number is taken, too."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise ValueError
        if not _within(value, self.low, self.high) or not math.isfinite(value):
            raise ValueError
        return float(value)

    def schema(self) -> dict[str, Any]:
        """See `Kind.schema`."""
        return {"type": "number", **_limits(self.low, self.high)}


@dataclass(frozen=True, slots=True)
class Flag:
    """True or false."""

    description: str
    allowed: str = "true or false"

    def read(self, value: object) -> object:
        """See `Kind.read`."""
        if not isinstance(value, bool):
            raise ValueError
        return value

    def schema(self) -> dict[str, Any]:
        """See `Kind.schema`."""
        return {"type": "boolean"}


@dataclass(frozen=True, slots=True)
class OneOf:
    """One of some words."""

    description: str
    words: tuple[str, ...]

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return "one of " + ", ".join(self.words)

    def read(self, value: object) -> object:
        """See `Kind.read`."""
        if value not in self.words:
            raise ValueError
        return value

    def schema(self) -> dict[str, Any]:
        """See `Kind.schema`."""
        return {"type": "string", "enum": list(self.words)}


@dataclass(frozen=True, slots=True)
class CobId:
    """A COB-ID, as a number or as people write it, e.g. ``0x181``."""

    description: str
    allowed: str = f'a COB-ID from 0 to {MAX_COB_ID}, or as text from "0x0" to "0x{MAX_COB_ID:X}"'

    def read(self, value: object) -> object:
        """See `Kind.read`."""
        if isinstance(value, str) and _HEXADECIMAL.fullmatch(value):
            value = int(value, 16)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MAX_COB_ID:
            raise ValueError
        return value

    def schema(self) -> dict[str, Any]:
        """See `Kind.schema`."""
        return {
            "anyOf": [
                {"type": "integer", "minimum": 0, "maximum": MAX_COB_ID},
                {"type": "string", "pattern": f"^{_HEXADECIMAL.pattern}$"},
            ]
        }


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a command; without a `default` it is `required`."""

    name: str
    kind: Kind
    required: bool
    default: object = None

    def read(self, command: str, value: object) -> object:
        """The value as the method gets it. Raises `BadValue` that says what is allowed."""
        if value is None and not self.required and self.default is None:
            return None
        try:
            return self.kind.read(value)
        except ValueError:
            shown = repr(value)
            raise BadValue(
                f"{command}: {self.name} must be {self.kind.allowed}, not {shown[:60]}",
                hint=self.kind.description,
            ) from None

    def schema(self) -> dict[str, Any]:
        """The JSON Schema of the parameter."""
        schema = self.kind.schema() | {"description": self.kind.description}
        if not self.required and self.default is not None:
            schema["default"] = self.default
        return schema


@dataclass(frozen=True, slots=True)
class Command:
    """One row: a name, what it does, what it takes, and the method that does it."""

    name: str
    summary: str
    """The first line of the method's docstring."""
    parameters: tuple[Parameter, ...]
    action: Callable[..., None]
    """Called with the panel, and the arguments that `check` gave, by name."""

    def check(self, given: Mapping[str, object]) -> dict[str, object]:
        """Arguments by name, read. Raises `BadValue` for a wrong, missing or unknown one."""
        known = {parameter.name: parameter for parameter in self.parameters}
        if unknown := [name for name in given if name not in known]:
            takes = ", ".join(known) or "nothing"
            raise BadValue(f"{self.name} takes no {unknown[0][:60]!r}", hint=f"It takes {takes}.")
        for parameter in self.parameters:
            if parameter.required and parameter.name not in given:
                raise BadValue(
                    f"{self.name} needs {parameter.name}: {parameter.kind.allowed}",
                    hint=parameter.kind.description,
                )
        return {name: known[name].read(self.name, value) for name, value in given.items()}

    def schema(self) -> dict[str, Any]:
        """The JSON Schema of the arguments as an object."""
        return {
            "type": "object",
            "title": "".join(part.capitalize() for part in self.name.split("_")),
            "properties": {parameter.name: parameter.schema() for parameter in self.parameters},
            "required": [parameter.name for parameter in self.parameters if parameter.required],
            "additionalProperties": False,
        }


class CommandTable(Mapping[str, Command]):
    """All commands of one class of panel, by name. Its methods enter it as the class is defined."""

    def __init__(self) -> None:
        self._rows: dict[str, Command] = {}

    def __getitem__(self, name: str) -> Command:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def enter(self, method: Callable[Concatenate[Panel, P], None]) -> Callable[Concatenate[Panel, P], None]:
        """Decorate a method: it is a row from now on, and checks its arguments whoever calls it."""
        signature = inspect.signature(method)
        loose = cast("Callable[..., None]", method)

        @functools.wraps(method)
        def checked(panel: Panel, /, *args: P.args, **kwargs: P.kwargs) -> None:
            given = signature.bind(panel, *args, **kwargs).arguments
            own = next(iter(signature.parameters))
            arguments = {name: value for name, value in given.items() if name != own}
            loose(panel, **row.check(arguments))

        row = Command(
            name=loose.__name__,
            summary=(inspect.getdoc(loose) or "").partition("\n")[0],
            parameters=tuple(_parameters(loose, signature)),
            action=loose,
        )
        self._rows[row.name] = row
        return checked

    def perform(self, panel: object, name: str, arguments: Mapping[str, object]) -> None:
        """Do what a command by name says.

        Raises `BadValue` for an unknown name or argument, and what the command itself raises.
        """
        row = self._rows.get(name)
        if row is None:
            raise BadValue(f"there is no command {name[:60]!r}", hint=f"Known are {', '.join(self._rows)}.")
        row.action(panel, **row.check(arguments))


def _parameters(method: Callable[..., None], signature: inspect.Signature) -> Iterator[Parameter]:
    hints = get_type_hints(method, include_extras=True)
    for name, parameter in list(signature.parameters.items())[1:]:
        required = parameter.default is inspect.Parameter.empty
        kind = cast("Kind", hints[name].__metadata__[0])
        yield Parameter(name, kind, required, None if required else parameter.default)


def _within(value: float, low: float, high: float | None) -> bool:
    return low <= value and (high is None or value <= high)


def _range(low: float, high: float | None) -> str:
    return f"from {_shown(low)} on" if high is None else f"from {_shown(low)} to {_shown(high)}"


def _shown(limit: float) -> str:
    return str(int(limit)) if limit == int(limit) else f"{limit:g}"


def _limits(low: float, high: float | None) -> dict[str, float]:
    return {"minimum": low} if high is None else {"minimum": low, "maximum": high}
