"""What users write for the service (settings, headers, numbers with units), and events that it writes."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from starlette.requests import Request

from app.axes.schemas import Quantity
from app.axes.units import Scale
from app.configuration.configuration import Configuration
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError
from app.events.streams import encode
from app.http.problems import ApiError
from app.http.waiting import LONGEST_WAIT, get_wait
from app.main import create_app
from app.objects.routes import parse_index
from drivers.bus.memory import MemoryWire
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import exact

NAMES = (
    "bus",
    "server",
    "network",
    "nodes",
    "objects",
    "log",
    "id",
    "name",
    "axes",
    "unit",
    "steps_per_unit",
)
NAMES += (
    "velocity",
    "soft_limits",
    "master_node_id",
    "heartbeat_ms",
    "host",
    "port",
    "token",
    "interface",
    "options",
)
NAMES += (
    "writable",
    "level",
    "model",
    "homing_method",
    "home_offset",
    "position_tolerance",
    "require_homing",
)
leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-2, 130),
    st.integers(),
    st.floats(),
    st.text(max_size=6),
    st.sampled_from(
        ("socketcand", "127.0.0.1", "0.0.0.0", "::1", "steps", "mm", "x", "stage", "debug", "TMCM-3216")
    ),
    st.sampled_from((1e308, 5e-324, -1.0, 2**31, 2**63)),
)
trees = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=4),
    max_leaves=12,
)
near_axes = st.fixed_dictionaries(
    {"name": st.sampled_from(("x", "y", "z"))},
    optional={
        "unit": st.sampled_from(("mm", "steps", "°")),
        "steps_per_unit": st.sampled_from((1.0, -50.0, 5e-324, 1e308, 0.1)) | st.floats(),
        "velocity": st.floats() | st.integers(),
        "acceleration": st.floats() | st.integers(),
        "soft_limits": st.lists(st.floats() | st.integers(), min_size=2, max_size=2),
        "home_offset": st.floats() | st.integers(),
        "position_tolerance": st.floats() | st.integers(),
        "homing_method": st.integers(-130, 130),
    },
)
near = st.fixed_dictionaries(
    {},
    optional={
        "nodes": st.lists(
            st.fixed_dictionaries(
                {"id": st.integers(0, 128), "name": st.sampled_from(("a", "b"))},
                optional={
                    "axes": st.lists(near_axes, max_size=4),
                    "model": st.sampled_from(("TMCM-3216", "no")),
                },
            ),
            max_size=3,
        ),
        "network": st.dictionaries(
            st.sampled_from(("master_node_id", "heartbeat_ms", "consumer_ms", "node_heartbeat_ms")),
            st.integers(0, 20_000),
            max_size=3,
        ),
        "server": st.dictionaries(
            st.sampled_from(("host", "port", "token", "allowed_hosts", "max_streams")), leaves, max_size=3
        ),
        "bus": st.dictionaries(
            st.sampled_from(("interface", "channel", "bitrate", "options")), leaves | trees, max_size=3
        ),
    },
)
texts = st.one_of(
    st.binary(max_size=40),
    st.text(max_size=40).map(lambda text: text.encode("utf-8", "surrogatepass")),
    trees.map(lambda tree: yaml.safe_dump(tree).encode()),
    near.map(lambda tree: yaml.safe_dump(tree).encode()),
)


@settings(max_examples=150)
@given(texts, st.sampled_from(("canaxis.yaml", "canaxis.toml")))
@example(b"[" * 3000, "canaxis.yaml")
@example(b"[" * 3000, "canaxis.toml")
@example(b"&a [*a]", "canaxis.yaml")
@example(b"nodes: &a [*a]", "canaxis.yaml")
@example(b"? [1]\n: 2", "canaxis.yaml")
@example(b"2001-99-99", "canaxis.yaml")
@example(b"!!int x", "canaxis.yaml")
@example(
    b"nodes: [{id: 1, name: a, axes: [{name: x, unit: mm, steps_per_unit: 1e308, velocity: 1e9}]}]",
    "canaxis.yaml",
)
@example(b"nodes: [{id: 1, name: a, axes: [{name: x, home_offset: 1e300}]}]", "canaxis.yaml")
@example(b"nodes: [{id: 1, name: a, axes: [{name: x, soft_limits: [.nan, 1]}]}]", "canaxis.yaml")
def test_any_settings_file_is_served_or_refused_with_a_sentence(text: bytes, name: str) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(text)
        serve_or_refuse(lambda: load_configuration(path))


variables = st.dictionaries(
    st.sampled_from(
        (
            "SERVER__PORT",
            "SERVER",
            "NODES",
            "BUS__OPTIONS",
            "NETWORK__HEARTBEAT_MS",
            "LOG__LEVEL",
            "NODES__0__ID",
            "X",
        )
    ),
    st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=12)
    | trees.map(json.dumps)
    | st.integers().map(str),
    max_size=3,
)


@given(variables)
@example({"SERVER": "[" * 3000})
@example({"SERVER__PORT": "9" * 5000})
def test_any_environment_is_served_or_refused_with_a_sentence(given_: dict[str, str]) -> None:
    environment = {"PATH": "", **{f"CANAXIS_{name}": value for name, value in given_.items()}}
    with TemporaryDirectory() as folder, mock.patch.dict(os.environ, environment, clear=True):
        path = Path(folder) / "empty.yaml"
        path.touch()
        serve_or_refuse(lambda: load_configuration(path))


def serve_or_refuse(load: Callable[[], Configuration]) -> None:
    try:
        loaded = load()
        wire = MemoryWire().port("master")
        create_app(loaded, wire)
    except ConfigurationError as error:
        assert str(error).strip()
    else:
        for node in loaded.network_config().nodes:
            for axis in node.axes:
                assert axis.steps_per_unit != 0
                assert isinstance(axis.steps_per_unit, Fraction)


numbers = st.one_of(st.integers(), st.floats(allow_nan=False, allow_infinity=False), st.just(-0.0))
scales = st.floats(-1e11, 1e11).filter(lambda x: abs(x) >= 1e-9)  # what `AxisConfig` takes


@given(st.sampled_from(("steps", "mm", "furlong", "")), st.sampled_from(("steps", "mm")), scales, numbers)
def test_a_number_with_a_unit_is_steps_or_refused(
    unit: str, own: str, per_unit: float, number: float
) -> None:
    axis = AxisConfig(name="x", unit=own, steps_per_unit=1.0 if own == "steps" else per_unit)
    try:
        scale = Scale.named(unit, axis)
        steps = scale.steps("target", number)
        rate = scale.rate("velocity", number)
    except ApiError as error:
        assert error.type.status == 422
        assert error.hint
        return
    assert isinstance(steps, int)
    assert rate is not None
    assert rate >= 1
    if unit != "steps":
        assert abs(steps - exact(number) * scale.ratio) <= Fraction(1, 2)


@given(st.integers(-(2**31), 2**31 - 1), scales)
def test_any_steps_have_a_finite_value_on_the_wire(steps: int, per_unit: float) -> None:
    quantity = Scale("mm", per_unit).quantity(steps)
    assert Quantity.model_validate_json(quantity.model_dump_json()) == quantity
    assert quantity.steps == steps


preferences = st.text(st.sampled_from('wait=0123456789;, "\t-.x'), max_size=24) | st.text(max_size=20)


@given(preferences)
@example("wait=" + "9" * 400)
def test_a_preference_is_a_bounded_wait_or_none(prefer: str) -> None:
    wait = asyncio.run(get_wait(Request({"type": "http"}), None, prefer))
    assert 0 <= wait.seconds <= LONGEST_WAIT
    if wait.preferred:
        assert "wait" in prefer.lower()
        assert any(character.isdecimal() for character in prefer)


@given(st.text(st.sampled_from("0xX19afAFgh٣ \n"), max_size=8) | st.text(max_size=6))
def test_an_index_is_sixteen_bits_or_refused(text: str) -> None:
    try:
        index = parse_index(text)
    except ApiError as error:
        assert error.hint
        return
    assert 0 <= index <= 0xFFFF
    assert int(text, 16) == index


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from(("axis", "node", "stop")), json_values, st.none() | st.integers(0, 2**63))
@example("axis", "a\r\nb\n\nc\u2028\u0085d\0", 1)
def test_an_event_is_read_back_as_it_was_meant(kind: str, data: object, event_id: int | None) -> None:
    fields: dict[str, str] = {}
    text = encode(kind, data, event_id).decode("utf-8")
    *lines, last, end = text.split("\n")
    assert last == end == ""
    for line in lines:
        assert "\r" not in line
        name, _, value = line.partition(": ")
        assert name not in fields
        fields[name] = value
    assert fields["event"] == kind
    assert fields.get("id") == (None if event_id is None else str(event_id))
    assert json.loads(fields["data"]) == data
