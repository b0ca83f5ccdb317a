"""SDO against the module: golden frames, and each refusal with the abort code of manual section 12."""

from __future__ import annotations

import pytest
from sim_core_kit import Bench

from drivers.cia301.sdo import AbortCode
from drivers.cia402.power import PowerState


@pytest.mark.parametrize(
    ("request_frame", "response"),
    [
        ("40 00 10 00 00 00 00 00", "43 00 10 00 92 01 fc ff"),  # device type FFFC0192h, §3.1.1
        ("40 18 10 01 00 00 00 00", "43 18 10 01 86 02 00 00"),  # vendor 286h, §3.1.13
        ("40 18 10 02 00 00 00 00", "43 18 10 02 90 0c 00 00"),  # product 3216
        ("40 18 10 03 00 00 00 00", "43 18 10 03 04 00 01 00"),  # firmware 1.04
        ("40 18 10 04 00 00 00 00", "43 18 10 04 39 30 00 00"),  # the serial number given
        ("40 09 10 00 00 00 00 00", "43 09 10 00 31 2e 30 30"),  # "1.00"
        ("40 0a 10 00 00 00 00 00", "43 0a 10 00 31 2e 30 34"),  # "1.04"
        ("40 10 10 01 00 00 00 00", "43 10 10 01 01 00 00 00"),  # can be stored
        ("40 10 10 03 00 00 00 00", "43 10 10 03 00 00 00 00"),  # can't
        ("40 14 10 00 00 00 00 00", "43 14 10 00 85 00 00 00"),  # 80h + node ID 5
        ("40 00 14 01 00 00 00 00", "43 00 14 01 05 02 00 40"),  # 200h + node ID, no RTR
        ("40 07 27 00 00 00 00 00", "4b 07 27 00 e8 03 00 00"),  # 1000 kbit/s in force
        ("40 08 27 00 00 00 00 00", "4f 08 27 00 05 00 00 00"),  # node ID in force
        ("40 41 60 00 00 00 00 00", "4b 41 60 00 40 02 00 00"),  # live from axis 0
        ("2b 17 10 00 c8 00 00 00", "60 17 10 00 00 00 00 00"),
        ("40 34 12 00 00 00 00 00", "80 34 12 00 00 00 02 06"),  # no such object
        ("40 18 10 05 00 00 00 00", "80 18 10 05 11 00 09 06"),  # no such sub-index
        ("40 03 10 00 00 00 00 00", "80 03 10 00 00 00 02 06"),  # 1003h does not exist here
        ("23 00 10 00 00 00 00 00", "80 00 10 00 02 00 01 06"),  # read only
        ("23 17 10 00 c8 00 00 00", "80 17 10 00 12 00 07 06"),  # four bytes for an U16
        ("2f 17 10 00 c8 00 00 00", "80 17 10 00 13 00 07 06"),  # one byte for an U16
        ("22 17 10 00 c8 00 00 00", "60 17 10 00 00 00 00 00"),  # size not indicated: cut to the object's
        ("2b 11 27 00 10 0f 00 00", "80 11 27 00 31 00 09 06"),  # 3856 > 3855
        ("2b 04 27 00 e7 03 00 00", "80 04 27 00 30 00 09 06"),  # no such bit rate
        ("2f 05 27 00 80 00 00 00", "80 05 27 00 30 00 09 06"),  # no such node ID
        ("a0 00 10 00 00 00 00 00", "80 00 10 00 01 00 04 05"),  # no block transfer
    ],
)
def test_golden_request_and_response(request_frame: str, response: str) -> None:
    bench = Bench(5, serial=12345)
    assert bench.sdo(request_frame) == response


def test_the_device_name_comes_in_segments() -> None:
    bench = Bench()
    assert bench.sdo("40 08 10 00 00 00 00 00") == "41 08 10 00 09 00 00 00"
    assert bench.sdo("60 00 00 00 00 00 00 00") == "00 54 4d 43 4d 2d 33 32"
    assert bench.sdo("70 00 00 00 00 00 00 00") == "1b 31 36 00 00 00 00 00"


def test_a_segmented_download_of_four_bytes_is_taken() -> None:
    bench = Bench()
    assert bench.sdo("21 7a 60 00 04 00 00 00") == "60 7a 60 00 00 00 00 00"
    assert bench.sdo("07 20 a1 07 00 00 00 00") == "20 00 00 00 00 00 00 00"
    assert bench.axes[0].log[-1] == (0x607A, 0, 500_000)


def test_other_nodes_requests_are_not_answered() -> None:
    assert Bench().send(0x602, "40 00 10 00 00 00 00 00") == []


def test_a_write_reaches_the_axis_by_its_base_index_and_no_other_axis() -> None:
    bench = Bench()
    assert bench.write(0x707A, 0, -5, "i") is None
    assert [axis.log[1:] for axis in bench.axes] == [[], [], [(0x607A, 0, -5)]]
    assert bench.read(0x707A, form="i") == -5
    assert bench.read(0x607A, form="i") == 0


def test_the_axis_finds_its_own_parameters_and_the_modules_by_base_index() -> None:
    bench = Bench()
    bench.write(0x6881, 0, 777)
    bench.write(0x2711, 0, 15, "H")
    parameters = bench.axes[1].parameters
    assert (parameters.get(0x6081), parameters.get(0x2711)) == (777, 15)
    parameters.set(0x6081, 0, 5)
    assert bench.read(0x6881) == 5
    with pytest.raises(KeyError):
        parameters.get(0x5FFF)


def test_an_object_that_is_bound_to_a_drive_state_is_refused_in_any_other() -> None:
    bench = Bench()
    assert bench.write(0x2205, 0, 3) is None
    bench.axes[1].state = PowerState.OPERATION_ENABLED
    assert bench.write(0x2205, 0, 3) == AbortCode.DEVICE_STATE
    assert bench.write(0x2005, 0, 3) is None, "axis 0 is still switched off"


def test_the_drives_veto_is_passed_on() -> None:
    bench = Bench()
    bench.axes[0].vetoes[0x6082] = AbortCode.PARAMETER_INCOMPATIBLE
    assert bench.write(0x6082, 0, 10) == 0x06040043


def test_a_write_that_the_axis_refuses_late_leaves_the_old_value() -> None:
    bench = Bench()
    bench.write(0x6081, 0, 5)
    bench.axes[0].failing.add(0x6081)
    assert bench.write(0x6081, 0, 6) == AbortCode.LOCAL_CONTROL
    assert bench.read(0x6081) == 5


def test_no_sdo_in_stopped() -> None:
    bench = Bench()
    bench.send(0, "02 01")
    assert bench.send(0x601, "40 00 10 00 00 00 00 00") == []


@pytest.mark.parametrize(
    ("index", "sub", "value", "form", "abort"),
    [
        (0x1005, 0, 0x40000080, "I", AbortCode.INVALID_VALUE),  # generate bit: no 1006h
        (0x1005, 0, 0x81, "I", None),
        (0x1005, 0, 0x601, "I", AbortCode.INVALID_VALUE),
        (0x1014, 0, 0x80000081, "I", None),
        (0x1014, 0, 0x20000081, "I", AbortCode.INVALID_VALUE),
        (0x1016, 1, 0x017F0064, "I", AbortCode.INVALID_VALUE),
        (0x1016, 1, 0x007F0064, "I", None),
        (0x1029, 1, 2, "B", None),
    ],
)
def test_communication_settings(index: int, sub: int, value: int, form: str, abort: int | None) -> None:
    bench = Bench()
    before = bench.read(index, sub, form)
    assert bench.write(index, sub, value, form) == abort
    assert bench.read(index, sub, form) == (before if abort else value)


def test_every_object_can_be_read_with_the_length_of_its_type() -> None:
    bench = Bench()
    for address, spec in bench.module.profile.objects.items():
        data = bench.module.dictionary.read(address, 0.0)
        assert spec.type.size in (None, len(data)), address


def test_every_rw_number_is_taken_at_its_limits_or_refused_with_a_code_and_unchanged() -> None:
    bench = Bench()
    for address, spec in bench.module.profile.objects.items():
        if not spec.access.writable or spec.address.index in (0x1010, 0x1011, 0x2706):
            continue
        for value in (spec.minimum, spec.maximum):
            assert spec.type.size is not None, address
            assert value is not None, address
            form = {1: "b", 2: "h", 4: "i"}[spec.type.size]
            form = form if spec.type.signed else form.upper()
            before = bench.module.dictionary.stored(address)
            abort = bench.write(address.index, address.sub, value, form)
            now = bench.module.dictionary.stored(address)
            assert now == (value if abort is None else before), address
