"""The table of the fault panel's commands: names, parameters, limits, and what a wrong call is told."""

from __future__ import annotations

import math

import pytest

from drivers.errors import BadValue
from drivers.sim.commands import CobId, Flag, Kind, OneOf, Real, Whole
from drivers.sim.panel import COMMANDS


def test_everything_that_a_lab_can_do_to_a_module_is_there() -> None:
    assert set(COMMANDS) == {
        *("press_switch", "release_switch", "block", "unblock", "set_load", "stall"),
        *("cut_supply", "restore_supply", "set_supply", "set_temperature", "short", "open_load", "mend"),
        *("set_shutdown_input", "set_digital_input", "set_analog_input"),
        *("power_off", "power_on", "power_cycle", "report_error"),
        *("bus_off", "recover_bus", "unplug", "plug"),
        *("set_silent", "set_deaf", "set_no_boot_up", "set_sdo_delay", "set_sdo_mute"),
        *("drop_frames", "delay_frames", "duplicate_frames", "corrupt_frames", "truncate_frames"),
        "end_wire_faults",
    }


@pytest.mark.parametrize("name", list(COMMANDS))
def test_each_command_and_parameter_explains_itself(name: str) -> None:
    row = COMMANDS[name]
    assert row.summary.endswith(".")
    for parameter in row.parameters:
        assert parameter.kind.description.endswith(".")
        assert parameter.kind.allowed
        assert parameter.schema()["description"] == parameter.kind.description


def test_a_schema_holds_limits_words_and_defaults() -> None:
    schema = COMMANDS["press_switch"].schema()
    assert schema["required"] == ["axis", "switch"]
    assert schema["additionalProperties"] is False
    assert schema["properties"]["switch"]["enum"] == ["negative", "positive", "home"]
    corrupt = COMMANDS["corrupt_frames"].schema()
    assert corrupt["required"] == ["cob_id"]
    assert corrupt["properties"]["bits"] == {
        "type": "integer",
        "minimum": 1,
        "maximum": 255,
        "default": 255,
        "description": "Which of its bits are flipped.",
    }
    assert "default" not in corrupt["properties"]["count"]


def test_good_arguments_are_read() -> None:
    assert COMMANDS["drop_frames"].check({"cob_id": "0x181", "count": 2}) == {"cob_id": 0x181, "count": 2}
    assert COMMANDS["drop_frames"].check({"cob_id": 0x181, "count": None})["count"] is None
    assert COMMANDS["set_sdo_delay"].check({"seconds": 1}) == {"seconds": 1.0}


@pytest.mark.parametrize(
    ("command", "arguments", "told"),
    [
        ("press_switch", {"axis": 0, "switch": "left"}, "one of negative, positive, home, not 'left'"),
        ("press_switch", {"axis": 0}, "press_switch needs switch: one of negative"),
        ("press_switch", {"axis": True, "switch": "home"}, "axis must be a whole number from 0 on, not True"),
        ("press_switch", {"axis": 1.0, "switch": "home"}, "axis must be a whole number"),
        ("press_switch", {"axis": None, "switch": "home"}, "axis must be a whole number"),
        ("set_sdo_delay", {"seconds": -0.1}, "seconds must be a number from 0 to 3600, not -0.1"),
        ("set_sdo_delay", {"seconds": math.nan}, "not nan"),
        ("set_sdo_delay", {"seconds": math.inf}, "not inf"),
        ("set_sdo_delay", {"seconds": True}, "not True"),
        ("set_silent", {"active": 1}, "true or false, not 1"),
        ("drop_frames", {"cob_id": "181"}, 'from "0x0" to "0x7FF"'),
        ("drop_frames", {"cob_id": 0x800}, "a COB-ID from 0 to 2047"),
        ("drop_frames", {"cob_id": 1, "count": 0}, "from 1 to 1000000, not 0"),
        ("set_analog_input", {"terminal": 2, "value": 0}, "from 0 to 1, not 2"),
        ("power_cycle", {"axis": 0}, "power_cycle takes no 'axis'"),
    ],
)
def test_bad_arguments_are_told_what_is_allowed(command: str, arguments: dict, told: str) -> None:
    with pytest.raises(BadValue) as refused:
        COMMANDS[command].check(arguments)
    assert told in refused.value.message
    assert refused.value.hint


def test_an_unknown_command_lists_the_known_ones() -> None:
    with pytest.raises(BadValue, match="no command 'explode'") as refused:
        COMMANDS.perform(object(), "explode", {})
    assert "press_switch" in refused.value.hint


@pytest.mark.parametrize(
    "kind", [Whole("W.", 1), Real("R.", 1.0), Flag("F."), OneOf("O.", ("a",)), CobId("C.")]
)
@pytest.mark.parametrize("value", [None, [], {}, "", "zz", b"a", -1, 1e400])
def test_no_kind_takes_what_it_can_not_be(kind: Kind, value: object) -> None:
    with pytest.raises(ValueError, match=r"^$"):
        kind.read(value)
