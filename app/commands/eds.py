"""`canaxis eds`: the module's electronic data sheet, as a file and held against a live node."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from app.commands.serve import parse_option
from app.configuration.configuration import BusConfiguration
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError
from drivers.bus.pythoncan import PythonCanBus
from drivers.devices.catalog import Catalog
from drivers.devices.eds import build_eds
from drivers.master.comparison import Comparison, Difference, compare

MODEL = "TMCM-3216"

eds = typer.Typer(
    help="The module's electronic data sheet (EDS): print it, write it, hold it against a live node.",
    no_args_is_help=True,
)

Model = Annotated[str, typer.Option(help="Model of the module.")]


@eds.command("print")
def print_eds(model: Model = MODEL) -> None:
    """Print the EDS."""
    sys.stdout.write(_text(Catalog.load(), model))


@eds.command()
def export(
    output: Annotated[Path, typer.Option(help="File to write.")],
    model: Model = MODEL,
) -> None:
    """Write the EDS to a file."""
    text = _text(Catalog.load(), model)
    try:
        output.write_text(text, encoding="ascii", newline="\n")
    except OSError as error:
        raise ConfigurationError(f"--output {output}: {error.strerror}") from error


@eds.command()
def check(
    node: Annotated[int, typer.Option(min=1, max=127, help="Node ID of the live module.")] = 1,
    config: Annotated[Path | None, typer.Option(help="Settings that name the bus.")] = None,
    interface: Annotated[str | None, typer.Option(help="python-can's interface, e.g. socketcan.")] = None,
    channel: Annotated[str | None, typer.Option(help="python-can's channel, e.g. can0.")] = None,
    bitrate: Annotated[int | None, typer.Option(help="bit/s, e.g. 1000000.")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="Another option of the interface, NAME=VALUE; may be repeated.")
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="Model to compare with; by the node's identity if left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Compare a live node with its EDS, object by object; exit code 1 if something differs.

    Nothing is written and nothing moves: objects are read, that is all. End the service first, or the two
    get in each other's way at the node.
    """
    catalog = Catalog.load()
    if model is not None:
        _known(catalog, model)
    given = {"interface": interface, "channel": channel, "bitrate": bitrate}
    overrides: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if option:
        overrides["options"] = dict(map(parse_option, option))
    bus = load_configuration(config, {"bus": overrides}).bus
    with Progress(console=Console(stderr=True), transient=True, disable=as_json) as progress:
        task = progress.add_task(f"Reading node {node}", total=None)

        def on_progress(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        outcome = asyncio.run(_compare(bus, node, catalog, model, on_progress))
    if as_json:
        print(json.dumps(_as_json(outcome), indent=2, ensure_ascii=False))
    else:
        _show(outcome, Console())
    if not outcome.agrees:
        raise typer.Exit(1)


async def _compare(
    configuration: BusConfiguration,
    node: int,
    catalog: Catalog,
    model: str | None,
    progress: Callable[[int, int], None],
) -> Comparison:
    bus = PythonCanBus(**configuration.arguments())
    await bus.open()
    try:
        return await compare(bus, node, catalog, model=model, progress=progress)
    finally:
        await bus.close()


def _text(catalog: Catalog, model: str) -> str:
    _known(catalog, model)
    return build_eds(catalog.profile(model))


def _known(catalog: Catalog, model: str) -> None:
    if model not in catalog.models:
        raise ConfigurationError(f"--model {model}: known are {', '.join(catalog.models)}")


# --- what came out ---


def _show(outcome: Comparison, console: Console) -> None:
    if outcome.differences:
        console.print(_table("What differs from the EDS", "In the EDS", outcome.differences))
    if outcome.settings:
        console.print(_table("What is set to another value than the default", "Default", outcome.settings))
    if outcome.foreign:
        console.print(
            f"{outcome.foreign} answers came that were not asked for here: another master reads this node, or"
            " two nodes have its ID.",
            style="yellow",
        )
    verdict = (
        "nothing differs from the EDS" if outcome.agrees else f"{len(outcome.differences)} objects differ"
    )
    console.print(
        f"Node {outcome.node}, {outcome.model}: {outcome.checked} objects read, {verdict},"
        f" {len(outcome.settings)} set to another value than the default."
    )


def _table(title: str, expected: str, rows: Iterable[Difference]) -> Table:
    table = Table("Object", "Name", "What", expected, "In the node", title=title, title_justify="left")
    for row in rows:
        cells = (str(row.address), row.name, row.kind.replace("_", " "), row.expected, row.found)
        table.add_row(*map(escape, cells))
    return table


def _as_json(outcome: Comparison) -> dict[str, Any]:
    return {
        "node": outcome.node,
        "model": outcome.model,
        "checked": outcome.checked,
        "agrees": outcome.agrees,
        "differences": [_row(one) for one in outcome.differences],
        "settings": [_row(one) for one in outcome.settings],
        "foreign_answers": outcome.foreign,
    }


def _row(one: Difference) -> dict[str, Any]:
    return {
        "index": f"0x{one.address.index:04X}",
        "sub": one.address.sub,
        "name": one.name,
        "kind": str(one.kind),
        "expected": one.expected,
        "found": one.found,
    }
