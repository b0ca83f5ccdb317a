"""A setting of an axis stands twice, as a row of the master and as a field on the wire: they agree."""

from __future__ import annotations

import pytest

from app.configuration.axes import AxisValues
from app.configuration.measures import DIMENSIONS, Measure, unit_of
from drivers.devices.catalog import Catalog
from drivers.master.plan.axis_fields import SETTINGS

GEARING = {"unit", "steps_per_unit", "full_steps", "microsteps", "gear", "pitch", "direction"}
SEVERAL_OBJECTS = GEARING | {"soft_limits"}
HELD = [(name, row.at) for name, row in SETTINGS.items() if row.at is not None]


def test_every_row_has_its_field_on_the_wire_and_the_other_way_round() -> None:
    assert set(AxisValues.model_fields) - SEVERAL_OBJECTS == set(SETTINGS)


def test_a_row_with_a_unit_is_a_number_with_a_unit_on_the_wire() -> None:
    measured = {
        name for name, field in AxisValues.model_fields.items() if field.annotation == (Measure | None)
    }
    assert measured - GEARING == set(DIMENSIONS)


@pytest.mark.parametrize(("name", "at"), HELD, ids=lambda value: value if isinstance(value, str) else "")
def test_what_is_read_of_a_setting_names_its_object(name: str, at: tuple[int, int]) -> None:
    index, sub = at
    described = AxisValues.model_fields[name].description or ""
    assert f"{index:X}h{f':{sub}' if sub else ''}" in described
    spec = Catalog.load().profile("TMCM-3216").spec(index, sub, 0)
    assert spec.name


@pytest.mark.parametrize("name", DIMENSIONS)
def test_what_is_read_of_a_setting_names_its_unit_if_it_names_one(name: str) -> None:
    described = AxisValues.model_fields[name].description or ""
    units = {word.strip(".,;") for word in described.replace(";", " ").split()} & {
        *("unit", "unit/s", "unit/s2", "ms", "%")
    }
    assert units <= {unit_of(name, "unit")}
