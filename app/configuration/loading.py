"""Reading the configuration: a file, the environment, what a command line says; and what is wrong with it."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from app.configuration.configuration import Configuration
from app.configuration.sections import ConfigurationError

ENV_PREFIX = "CANAXIS_"
CONFIG_VARIABLE = "CANAXIS_CONFIG"
DEFAULT_FILE = Path("canaxis.yaml")
_WORDS = {"extra_forbidden": "no such setting", "model_type": "a mapping of settings is expected"}
"""Pydantic's types of errors -> what we say; for any other its own message will do."""


def load_configuration(path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> Configuration:
    """Read the settings: defaults < file < environment < `overrides` (nested; the command line).

    Without `path`, the file named by ``CANAXIS_CONFIG`` is taken, else ``canaxis.yaml`` here if it exists.
    Raises `ConfigurationError` with every key that is wrong.
    """
    variables = _variables(os.environ)
    source = path or (Path(os.environ[CONFIG_VARIABLE]) if os.environ.get(CONFIG_VARIABLE) else None)
    if source is None and DEFAULT_FILE.is_file():
        source = DEFAULT_FILE
    values: dict[str, Any] = {} if source is None else _read_file(source)
    if source is not None:
        _check_private(source, values)
    try:
        if variables:
            values = _merged(values, _from_environment())
        return Configuration(**_merged(values, overrides or {}))
    except ValidationError as error:
        raise ConfigurationError(_explain(error, source)) from error
    except RecursionError as error:
        raise ConfigurationError("the settings have brackets within brackets beyond all bounds") from error


def _variables(environ: Mapping[str, str]) -> list[str]:
    """The variables that are settings. Raises `ConfigurationError` for one that only looks like it."""
    known = {ENV_PREFIX + name.upper() for name in Configuration.model_fields} | {CONFIG_VARIABLE}
    ours = sorted(name for name in environ if name.upper().startswith(ENV_PREFIX))
    for name in ours:
        if name.upper().split("__")[0] not in known:
            raise ConfigurationError(f"{name}: no such setting; known are {', '.join(sorted(known))}")
    return [name for name in ours if name != CONFIG_VARIABLE]


def _from_environment() -> dict[str, Any]:
    import pydantic_settings  # takes 20 ms: a service without variables starts without it

    source = pydantic_settings.EnvSettingsSource(
        cast("type[pydantic_settings.BaseSettings]", Configuration),
        env_prefix=ENV_PREFIX,
        env_nested_delimiter="__",
        env_ignore_empty=True,
    )
    try:
        return source()
    except pydantic_settings.SettingsError as error:
        raise ConfigurationError(f"{error} (lists and mappings are written in JSON)") from error


def _read_file(path: Path) -> dict[str, Any]:
    import yaml  # takes 15 ms: a service without a file starts without it

    try:
        text = path.read_text(encoding="utf-8")
        data: object = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}") from error
    except RecursionError as error:
        raise ConfigurationError(f"{path}: brackets within brackets beyond all bounds") from error
    except (ValueError, yaml.YAMLError) as error:  # no UTF-8, no TOML, or a date like 2001-99-99
        raise ConfigurationError(f"{path}: {error}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: a mapping of settings is expected at the top")
    return {str(key): value for key, value in cast("dict[object, Any]", data).items()}


def _check_private(path: Path, values: Mapping[str, Any]) -> None:
    """Others on this machine must not read a token."""
    server: object = values.get("server")
    holds = isinstance(server, Mapping) and "token" in server
    if holds and path.stat().st_mode & 0o077:
        raise ConfigurationError(
            f"{path} holds server.token: it must be readable by its owner only (chmod 600)"
        )


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        known = result.get(key)
        if isinstance(value, Mapping) and isinstance(known, Mapping):
            result[key] = _merged(cast("Mapping[str, Any]", known), cast("Mapping[str, Any]", value))
        else:
            result[key] = value
    return result


def _explain(error: ValidationError, source: Path | None) -> str:
    def line(item: Mapping[str, Any]) -> str:
        where = ".".join(str(part) for part in item["loc"]) or "settings"
        what = _WORDS.get(item["type"], item["msg"])
        return f"{where}: {what}"

    lines = [line(item) for item in cast("list[Mapping[str, Any]]", error.errors(include_url=False))]
    return "\n".join([f"in {source}:", *lines] if source else lines)
