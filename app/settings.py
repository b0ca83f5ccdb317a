"""One tree of settings: a YAML or TOML file, then environment variables, then what a command line says.

The bus speaks python-can's own vocabulary (`interface`, `channel`, `bitrate`, and whatever else its interface
takes under `options`). Lengths, speeds and accelerations of an axis are in the axis's own `unit`; the drivers
get steps. A key that isn't known is an error that names the key.
"""

from __future__ import annotations

import ipaddress
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self, cast

import yaml
from pydantic import BaseModel, ConfigDict, Field, SecretStr, ValidationError, model_validator
from pydantic_settings import BaseSettings, EnvSettingsSource, PydanticBaseSettingsSource, SettingsConfigDict
from pydantic_settings import SettingsError as UnreadableVariable

from drivers.errors import BadValue
from drivers.master.config import AxisConfig, NetworkConfig, NodeConfig

ENV_PREFIX = "CANAXIS_"
CONFIG_VARIABLE = "CANAXIS_CONFIG"
DEFAULT_FILE = Path("canaxis.yaml")

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_RATES = (
    "velocity",
    "acceleration",
    "deceleration",
    "quick_stop_deceleration",
    "start_velocity",
    "end_velocity",
    "homing_fast",
    "homing_slow",
    "homing_acceleration",
)
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,62}$")]


class SettingsError(Exception):
    """The settings can't be used; the text says which key and why, one line for each."""


class Section(BaseModel):
    """A part of the tree; refuses keys that it doesn't know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BusSettings(Section):
    """Which wire to open, in python-can's words."""

    interface: str = "socketcand"
    channel: str | None = "can0"
    bitrate: int | None = Field(default=None, gt=0, le=1_000_000, description="bit/s")
    options: dict[str, Any] = Field(default_factory=dict, description="Further options of the interface.")

    def arguments(self) -> dict[str, Any]:
        """What `PythonCanBus` takes."""
        return {
            "interface": self.interface,
            "channel": self.channel,
            "bitrate": self.bitrate,
            **self.options,
        }


class ServerSettings(Section):
    """Where the service listens, and who may speak to it."""

    host: str = "127.0.0.1"
    port: int = Field(default=8402, ge=0, le=65535, description="0 lets the system choose.")
    token: SecretStr | None = Field(default=None, description="Bearer token; at least 16 characters.")
    token_file: Path | None = Field(default=None, description="File that holds the token; mode 0600.")
    allowed_hosts: tuple[str, ...] = Field(default=(), description="Further values of the Host header.")
    allowed_origins: tuple[str, ...] = Field(default=(), description="Origins of web pages that may command.")
    max_streams: int = Field(default=64, ge=1, description="Event streams open at once.")
    stop_timeout: Positive = Field(default=5.0, description="Seconds that open requests get at shutdown.")

    @property
    def is_loopback(self) -> bool:
        """Whether only programs on this machine can reach us."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"  # any other name may lead anywhere

    def read_token(self) -> str | None:
        """The token, from the setting or its file. Raises `SettingsError` if it can't be used."""
        if self.token is not None:
            token = self.token.get_secret_value()
        elif self.token_file is not None:
            token = _token_from(self.token_file)
        else:
            return None
        if len(token) < 16 or not token.isascii() or any(c.isspace() for c in token):
            raise SettingsError(
                "server.token: at least 16 ASCII characters without spaces are needed; "
                "`openssl rand -hex 16` makes some"
            )
        return token


class ObjectsSettings(Section):
    """Raw access to the object dictionary."""

    writable: bool = Field(default=False, description="Whether PUT on objects is allowed at all.")


class LogSettings(Section):
    """What is logged, and how."""

    level: str = Field(default="info", pattern="^(debug|info|warning|error)$")
    format: str = Field(default="console", pattern="^(console|json)$")


class AxisSettings(Section):
    """One axis; what is left out keeps the driver's default, which is given in steps."""

    name: Name
    unit: str = Field(default="steps", pattern=r"^[A-Za-z°µ%][A-Za-z0-9°µ%]{0,15}$")
    steps_per_unit: float = Field(
        default=1.0,
        allow_inf_nan=False,
        description="Microsteps in one unit; negative turns the axis around.",
    )
    velocity: Positive | None = Field(default=None, description="unit/s")
    acceleration: Positive | None = Field(default=None, description="unit/s2")
    deceleration: Positive | None = Field(default=None, description="unit/s2")
    quick_stop_deceleration: Positive | None = Field(default=None, description="unit/s2")
    start_velocity: NotNegative | None = Field(default=None, description="unit/s")
    end_velocity: NotNegative | None = Field(default=None, description="unit/s")
    homing_method: int | None = Field(default=None, ge=-128, le=127)
    homing_fast: Positive | None = Field(default=None, description="unit/s")
    homing_slow: Positive | None = Field(default=None, description="unit/s")
    homing_acceleration: Positive | None = Field(default=None, description="unit/s2")
    soft_limits: tuple[float, float] | None = Field(default=None, description="unit; lower, upper")
    home_offset: float | None = Field(default=None, allow_inf_nan=False, description="unit")
    position_tolerance: NotNegative | None = Field(default=None, description="unit; only with an encoder")
    switch_parameters: int | None = Field(default=None, ge=0, le=63, description="Object 2005h.")
    require_homing: bool | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.steps_per_unit == 0:
            raise ValueError("steps_per_unit must not be 0")
        if self.unit == "steps" and self.steps_per_unit != 1.0:
            raise ValueError("steps_per_unit must be 1 where the unit is steps; name the unit, e.g. mm")
        if self.soft_limits is not None and self.soft_limits[0] >= self.soft_limits[1]:
            raise ValueError("soft_limits: the lower limit must be below the upper one")
        return self

    def to_config(self) -> AxisConfig:
        """The same in steps."""
        values: dict[str, Any] = {}
        for key in _RATES:
            value = cast("float | None", getattr(self, key))
            if value is not None:
                values[key] = max(1, round(value * abs(self.steps_per_unit))) if value else 0
        for key in ("homing_method", "switch_parameters", "require_homing"):
            if (value := getattr(self, key)) is not None:
                values[key] = value
        if self.home_offset is not None:
            values["home_offset"] = round(self.home_offset * self.steps_per_unit)
        if self.position_tolerance is not None:
            values["position_tolerance"] = round(self.position_tolerance * abs(self.steps_per_unit))
        if self.soft_limits is not None:
            lower, upper = sorted(round(limit * self.steps_per_unit) for limit in self.soft_limits)
            values["soft_limits"] = (lower, upper)
        return AxisConfig(name=self.name, unit=self.unit, steps_per_unit=self.steps_per_unit, **values)


def _three_axes() -> tuple[AxisSettings, ...]:
    return tuple(AxisSettings(name=name) for name in ("x", "y", "z"))


class NodeSettings(Section):
    """One module on the bus."""

    id: int = Field(ge=1, le=127)
    name: Name
    model: str = "TMCM-3216"
    axes: tuple[AxisSettings, ...] = Field(default_factory=_three_axes, min_length=1)

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names):
            raise ValueError("axes: two axes have the same name")
        return self

    def to_config(self) -> NodeConfig:
        """What the master takes."""
        return NodeConfig(
            node_id=self.id,
            name=self.name,
            model=self.model,
            axes=tuple(axis.to_config() for axis in self.axes),
        )


def _one_node() -> tuple[NodeSettings, ...]:
    return (NodeSettings(id=1, name="stage"),)


class NetworkSettings(Section):
    """What the master itself is on the bus, and how who watches whom."""

    master_node_id: int | None = Field(default=None, ge=1, le=127)
    heartbeat_ms: int | None = Field(default=None, ge=10, le=1000)
    consumer_ms: int | None = Field(default=None, ge=50, le=10_000)
    node_heartbeat_ms: int | None = Field(default=None, ge=10, le=10_000)
    allow_unverified_failsafe: bool | None = None


class Settings(BaseSettings):
    """All of it."""

    model_config = SettingsConfigDict(
        extra="forbid", frozen=True, env_prefix=ENV_PREFIX, env_nested_delimiter="__", env_ignore_empty=True
    )

    bus: BusSettings = Field(default_factory=BusSettings)
    server: ServerSettings = Field(default_factory=ServerSettings)
    network: NetworkSettings = Field(default_factory=NetworkSettings)
    nodes: tuple[NodeSettings, ...] = Field(default_factory=_one_node, min_length=1)
    objects: ObjectsSettings = Field(default_factory=ObjectsSettings)
    log: LogSettings = Field(default_factory=LogSettings)

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Only what the caller gives: `load_settings` says what goes over what."""
        del settings_cls, env_settings, dotenv_settings, file_secret_settings
        return (init_settings,)

    @model_validator(mode="after")
    def _check(self) -> Self:
        ids = [node.id for node in self.nodes]
        names = [node.name for node in self.nodes]
        if len(set(ids)) != len(ids):
            raise ValueError("nodes: two nodes have the same id")
        if len(set(names)) != len(names):
            raise ValueError("nodes: two nodes have the same name")
        return self

    def network_config(self) -> NetworkConfig:
        """What the master takes. Raises `SettingsError` for what it refuses."""
        given = self.network.model_dump(exclude_none=True)
        try:
            return NetworkConfig(nodes=tuple(node.to_config() for node in self.nodes), **given)
        except BadValue as error:
            raise SettingsError(error.message) from error

    def check_exposure(self) -> None:
        """Refuse an address that others can reach without a token. Raises `SettingsError`."""
        if self.server.read_token() is None and not self.server.is_loopback:
            raise SettingsError(
                f"server.host: {self.server.host} can be reached by others, and no token is set; "
                "set server.token or server.token_file, or listen on 127.0.0.1"
            )


def load_settings(path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> Settings:
    """Read the settings: defaults < file < environment < `overrides` (nested; the command line).

    Without `path`, the file named by ``CANAXIS_CONFIG`` is taken, else ``canaxis.yaml`` here if it exists.
    Raises `SettingsError` with every key that is wrong.
    """
    _check_environment(os.environ)
    source = path or (Path(os.environ[CONFIG_VARIABLE]) if os.environ.get(CONFIG_VARIABLE) else None)
    if source is None and DEFAULT_FILE.is_file():
        source = DEFAULT_FILE
    values: dict[str, Any] = {} if source is None else _read_file(source)
    try:
        values = _merged(values, EnvSettingsSource(Settings)())
        return Settings(**_merged(values, overrides or {}))
    except ValidationError as error:
        raise SettingsError(_explain(error, source)) from error
    except UnreadableVariable as error:
        raise SettingsError(f"{error} (lists and mappings are written in JSON)") from error


def _check_environment(environ: Mapping[str, str]) -> None:
    known = {ENV_PREFIX + name.upper() for name in Settings.model_fields} | {CONFIG_VARIABLE}
    for name in sorted(environ):
        if name.upper().startswith(ENV_PREFIX) and name.upper().split("__")[0] not in known:
            raise SettingsError(f"{name}: no such setting; known are {', '.join(sorted(known))}")


def _read_file(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        data: object = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    except OSError as error:
        raise SettingsError(f"{path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, yaml.YAMLError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: {error}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise SettingsError(f"{path}: a mapping of settings is expected at the top")
    return {str(key): value for key, value in cast("dict[object, Any]", data).items()}


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        known = result.get(key)
        if isinstance(value, Mapping) and isinstance(known, Mapping):
            result[key] = _merged(cast("Mapping[str, Any]", known), cast("Mapping[str, Any]", value))
        else:
            result[key] = value
    return result


def _token_from(path: Path) -> str:
    try:
        if path.stat().st_mode & 0o077:
            raise SettingsError(f"server.token_file: {path} must be readable by its owner only (chmod 600)")
        return path.read_text(encoding="ascii").strip()
    except OSError as error:
        raise SettingsError(f"server.token_file: {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"server.token_file: {path} is no ASCII text") from error


def _explain(error: ValidationError, source: Path | None) -> str:
    def line(item: Mapping[str, Any]) -> str:
        where = ".".join(str(part) for part in item["loc"]) or "settings"
        what = "no such setting" if item["type"] == "extra_forbidden" else item["msg"]
        return f"{where}: {what}"

    lines = [line(item) for item in cast("list[Mapping[str, Any]]", error.errors(include_url=False))]
    return "\n".join([f"in {source}:", *lines] if source else lines)
