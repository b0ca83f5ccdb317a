"""Settings: where they come from, what they refuse, and what the drivers get of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.commands.serve import parse_node, parse_option
from app.commands.simulate import parse_nodes
from app.configuration.axes import AxisSettings
from app.configuration.configuration import Configuration
from app.configuration.loading import load_configuration
from app.configuration.sections import ConfigurationError
from app.main import create_app

TOKEN = "0f1e2d3c4b5a69788796a5b4c3d2e1f0"


@pytest.fixture(autouse=True)
def _in_an_empty_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_defaults_serve_the_simulator_on_this_machine() -> None:
    configuration = load_configuration()
    assert configuration.bus.arguments() == {"interface": "socketcand", "channel": "can0", "bitrate": None}
    assert (configuration.server.host, configuration.server.port) == ("127.0.0.1", 8402)
    [node] = configuration.network_config().nodes
    assert (node.node_id, node.model) == (1, "TMCM-3216")
    assert [axis.name for axis in node.axes] == ["x", "y", "z"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("canaxis.yaml", "bus: {interface: socketcan, channel: can1, bitrate: 500000}"),
        ("canaxis.toml", "[bus]\ninterface = 'socketcan'\nchannel = 'can1'\nbitrate = 500000"),
    ],
)
def test_a_file_speaks_python_cans_words(tmp_path: Path, name: str, text: str) -> None:
    configuration = load_configuration(write(tmp_path / name, text))
    assert configuration.bus.arguments() == {"interface": "socketcan", "channel": "can1", "bitrate": 500000}


def test_the_command_line_goes_over_the_environment_over_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "canaxis.yaml", "server: {port: 1001, host: 127.0.0.2, max_streams: 3}")
    monkeypatch.setenv("CANAXIS_SERVER__PORT", "1002")
    monkeypatch.setenv("CANAXIS_SERVER__HOST", "127.0.0.3")
    server = load_configuration(None, {"server": {"port": 1003}}).server
    assert (server.port, server.host, server.max_streams) == (1003, "127.0.0.3", 3)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("sever: {port: 1}", "sever"),
        ("server: {prot: 1}", "server.prot"),
        ("nodes: [{id: 1, name: a, axes: [{name: x, sped: 3}]}]", "nodes.0.axes.0.sped"),
        ("server: {port: 70000}", "server.port"),
        ("nodes: [{id: 200, name: a}]", "nodes.0.id"),
        ("nodes: [{id: 1, name: a}, {id: 1, name: b}]", "same id"),
        ("nodes: [{id: 1, name: a, axes: [{name: x, unit: mm, steps_per_unit: 0}]}]", "steps_per_unit"),
        ("[1, 2]", "mapping"),
        ("server: 5", "server: a mapping"),
        ("server: {", "canaxis.yaml"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        load_configuration(write(tmp_path / "canaxis.yaml", text))


@pytest.mark.parametrize("name", ["CANAXIS_SEVER__PORT", "CANAXIS_SERVER__TOKN"])
def test_an_unknown_environment_variable_is_named(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(name, "x")
    with pytest.raises(ConfigurationError, match=r"SEVER|tokn"):
        load_configuration()


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml"):
        load_configuration(tmp_path / "nowhere.yaml")


def test_lengths_are_in_the_axis_unit() -> None:
    axis = AxisSettings.model_validate(
        {
            "name": "x", "unit": "mm", "steps_per_unit": -100.0, "velocity": 2.5, "acceleration": 0.001,
            "soft_limits": [-10.0, 30.0], "home_offset": 1.0, "start_velocity": 0,
        }
    ).to_config()  # fmt: skip
    assert axis.velocity == 250
    assert axis.acceleration == 1, "never rounded down to standing"
    assert axis.soft_limits == (-3000, 1000), "a turned axis turns its limits"
    assert axis.home_offset == -100
    assert axis.start_velocity == 0


def test_what_the_drivers_refuse_names_the_axis() -> None:
    configuration = Configuration.model_validate(
        {"nodes": [{"id": 1, "name": "a", "axes": [{"name": "q", "velocity": 1e9}]}]}
    )
    with pytest.raises(ConfigurationError, match="'q'"):
        configuration.network_config()


def test_another_address_needs_a_token(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="token"):
        load_configuration(None, {"server": {"host": "0.0.0.0"}}).check_exposure()
    load_configuration(None, {"server": {"host": "0.0.0.0", "token": TOKEN}}).check_exposure()
    for host in ("127.0.0.9", "localhost", "::1"):
        load_configuration(None, {"server": {"host": host}}).check_exposure()


@pytest.mark.parametrize(
    "host", ["::", "", "192.168.1.5", "lab-pc", "127.0.0.1.evil.example", "::ffff:1.2.3.4"]
)
def test_no_address_that_others_reach_goes_without_a_token(host: str) -> None:
    with pytest.raises(ConfigurationError, match="token"):
        load_configuration(None, {"server": {"host": host}}).check_exposure()


@pytest.mark.parametrize("token", ["0123456789abcdef", "a" * 40, "0f1e2d3c 4b5a69788796a5b4c3d2", "ö" * 22])
def test_a_token_that_could_be_guessed_is_refused_and_not_shown(token: str) -> None:
    with pytest.raises(ConfigurationError, match=r"server\.token: ") as caught:
        load_configuration(None, {"server": {"token": token}})
    assert token not in str(caught.value)


def test_settings_with_a_token_must_be_private(tmp_path: Path) -> None:
    file = write(tmp_path / "canaxis.yaml", "server: {token: 0f1e2d3c4b5a69788796a5b4c3d2e1f0}\n")
    file.chmod(0o644)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        load_configuration(file)
    file.chmod(0o600)
    assert load_configuration(file).server.has_token


def test_the_token_is_not_shown() -> None:
    configuration = load_configuration(None, {"server": {"token": TOKEN}})
    assert TOKEN not in repr(configuration)


def test_command_line_texts() -> None:
    assert parse_option("port=29537") == ("port", 29537)
    assert parse_option("host=lab=1") == ("host", "lab=1")
    assert parse_node("5") == {"id": 5, "name": "node5"}
    assert parse_node("5:stage:TMCM-3216") == {"id": 5, "name": "stage", "model": "TMCM-3216"}
    assert parse_nodes("1-3, 7") == [1, 2, 3, 7]
    for parse, text in (
        (parse_option, "port"),
        (parse_node, "x:1"),
        (parse_nodes, "0"),
        (parse_nodes, "5-3"),
    ):
        with pytest.raises(ConfigurationError):
            parse(text)


@pytest.mark.parametrize(
    ("bus", "words"),
    [
        ({"interface": "sockectan"}, "socketcan,"),
        ({"options": {"receive_own_messages": True}}, "bus.options"),
        ({"options": {"port": "x"}}, "bus.options"),
    ],
)
def test_what_can_never_be_a_bus_is_refused_before_anything_runs(bus: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        create_app(Configuration.model_validate({"bus": bus}))


@pytest.mark.parametrize(
    ("node", "words"),
    [
        ({"model": "TMCM-9999"}, "TMCM-9999"),
        ({"axes": [{"name": name} for name in "abcd"]}, "3 axes"),
    ],
)
def test_what_no_module_can_be_is_refused_before_anything_runs(node: dict[str, object], words: str) -> None:
    configuration = Configuration.model_validate({"nodes": [{"id": 1, "name": "stage", **node}]})
    with pytest.raises(ConfigurationError, match=words):
        create_app(configuration)
