"""`canaxis settings`: the settings of a running service as a YAML file, over HTTP."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, cast

import httpx
import typer
import yaml

from app.configuration.sections import ConfigurationError

settings = typer.Typer(help="Export, compare, apply and roll back the settings of a running service.")

Url = Annotated[str, typer.Option(help="Where the service is.")]
TokenFile = Annotated[Path | None, typer.Option(help="File with the token, if the service wants one.")]
File = Annotated[Path, typer.Argument(help="A settings file: `nodes` as in canaxis.yaml.")]

DEFAULT_URL = "http://127.0.0.1:8402"
TIMEOUT = 60.0


@settings.command("export")
def export_settings(url: Url = DEFAULT_URL, token_file: TokenFile = None) -> None:
    """Print the settings of now as YAML: to edit, to compare, to apply, or for canaxis.yaml."""
    print(_ask("GET", "", url, token_file, accept="application/yaml").text, end="")


@settings.command("diff")
def diff_settings(
    file: Annotated[Path | None, typer.Argument(help="A settings file; none: the kept settings.")] = None,
    url: Url = DEFAULT_URL,
    token_file: TokenFile = None,
) -> None:
    """Tell in what the file, the settings and the modules differ. Ends with 1 if they do."""
    found = _ask("POST", "/diff", url, token_file, None if file is None else _read(file)).json()
    for one in found["fields"]:
        print(f"{one['name']} {one['setting']}: {_shown(one['kept'])} -> {_shown(one['wanted'])}")
    for one in found["objects"]:
        off = " (only while disabled)" if one["needs_disable"] else ""
        print(
            f"{one['name']} {one['index']}:{one['sub']} {one['object']}: the module holds {one['held']}, "
            f"wanted is {one['wanted']} {one['unit']}".rstrip()
            + off
        )
    for one in found["unread"]:
        print(f"node {one['node']} can't be read: {one['reason']}")
    if not found["equal"]:
        raise typer.Exit(1)
    print(f"no difference in {found['compared']} objects")


@settings.command("apply")
def apply_settings(file: File, url: Url = DEFAULT_URL, token_file: TokenFile = None) -> None:
    """Go by a file: all or nothing over its axes, each object read back."""
    _tell(_ask("POST", "/apply", url, token_file, _read(file)).json())


@settings.command("rollback")
def roll_back_settings(
    revision: Annotated[int, typer.Argument(help="0: the service's settings file alone.")],
    url: Url = DEFAULT_URL,
    token_file: TokenFile = None,
) -> None:
    """Go back to a revision, as a new one."""
    _tell(_ask("POST", "/rollback", url, token_file, {"revision": revision}).json())


def _ask(
    method: str, path: str, url: str, token_file: Path | None, body: object = None, *, accept: str = "*/*"
) -> httpx.Response:
    """One request. Raises `ConfigurationError` with what the service says, or why it can't be asked."""
    headers = {"Accept": accept, "Content-Type": "application/json"}
    if token_file is not None:
        try:
            headers["Authorization"] = f"Bearer {token_file.read_text(encoding='utf-8').strip()}"
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{token_file}: {error}") from error
    address = f"{url.rstrip('/')}/api/v1/settings{path}"
    try:
        response = httpx.request(method, address, json=body, headers=headers, timeout=TIMEOUT)
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise ConfigurationError(f"{address}: {error}") from error
    if response.is_success:
        return response
    try:
        problem: dict[str, Any] = response.json()
    except ValueError:
        raise ConfigurationError(f"{address}: status {response.status_code}") from None
    raise ConfigurationError(
        f"{problem.get('detail', response.status_code)}\n{problem.get('hint', '')}".strip()
    )


def _read(file: Path) -> dict[str, Any]:
    """The `nodes` of a settings file; what else canaxis.yaml has is no setting of an axis."""
    try:
        document: object = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        raise ConfigurationError(f"{file}: {error}") from error
    if not isinstance(document, dict) or "nodes" not in document:
        raise ConfigurationError(f"{file}: a mapping with nodes is expected at the top")
    return {"nodes": cast("dict[str, Any]", document)["nodes"]}


def _tell(applied: dict[str, Any]) -> None:
    for axis in applied["axes"]:
        for one in axis["written"]:
            print(f"{axis['name']} {one['index']}:{one['sub']} {one['name']}: {one['old']} -> {one['new']}")
    lasts = "" if applied["durable"] else ", kept until the service ends (it has no store.file)"
    print(f"revision {applied['revision']}{lasts}", file=sys.stderr)


def _shown(value: object) -> str:
    if isinstance(value, dict):
        measure = cast("dict[str, Any]", value)
        return f"{measure.get('value')} {measure.get('unit')}"
    if isinstance(value, list):
        return ", ".join(_shown(item) for item in cast("list[object]", value))
    return "default" if value is None else str(value)
