"""What a path's text says: which number of a row belongs to which axis, as a position or as a velocity."""

from __future__ import annotations

import io
import itertools

import pytest

from app.http.uploads import CSV, Upload
from app.trajectories.reading import read_points
from drivers.master.together.trajectory_path import Point

VELOCITIES = {"x": 1.0, "y": 2.0, "z": 3.0}


def points_of(text: str) -> list[Point]:
    content = text.encode()
    reading = read_points(Upload(io.BytesIO(content), CSV, len(content), b""), None)
    try:
        return list(reading.points.points())
    finally:
        reading.points.close()


@pytest.mark.parametrize("order", list(itertools.permutations("xyz")), ids="".join)
def test_velocities_belong_to_the_axes_that_their_columns_name(order: tuple[str, ...]) -> None:
    columns = ",".join(f"stage.{axis}.v[mm/s]" for axis in order)
    row = ",".join(str(VELOCITIES[axis]) for axis in order)
    (point,) = points_of(f"t,stage.x[mm],stage.y[mm],stage.z[mm],{columns}\n0.5,10,20,30,{row}\n")
    assert point == Point(0.5, (10.0, 20.0, 30.0), (1.0, 2.0, 3.0))
