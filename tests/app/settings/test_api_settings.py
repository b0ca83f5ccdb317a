"""Settings over HTTP: of an axis, as a document, as revisions, and the module's own memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from api_bench import Bench, running

from app.configuration.configuration import Configuration
from drivers.cia301.objects import Address

pytestmark = pytest.mark.looptime

PATH = "/api/v1/nodes/1/axes/x/settings"
X = {"name": "x", "unit": "mm", "pitch": "5 mm", "velocity": 10, "soft_limits": [0, "120 mm"]}


def settings_of(*axes: dict[str, Any], store: Path | None = None) -> Configuration:
    return Configuration.model_validate(
        {"nodes": [{"id": 1, "name": "stage", "axes": list(axes) or [X]}], "store": {"file": store}}
    )


async def configuration(bench: Bench) -> tuple[dict[str, Any], str]:
    """The settings of x, and their ETag."""
    response = await bench.client.get(PATH)
    assert response.status_code == 200, response.text
    return response.json(), response.headers["etag"]


async def patch(bench: Bench, body: object, tag: str | None = "*") -> httpx.Response:
    return await bench.client.patch(PATH, json=body, headers={} if tag is None else {"If-Match": tag})


async def held(bench: Bench, index: int, sub: int = 0) -> object:
    return await bench.service.network.node(1).read(Address(index, sub))


def mm(value: float) -> dict[str, Any]:
    return {"value": value, "unit": "mm"}


async def test_every_setting_has_its_unit_its_source_and_its_object() -> None:
    async with running(settings_of()) as bench:
        await bench.until_ready()
        told, _ = await configuration(bench)
        assert told["settings"]["velocity"] == {"value": 10, "unit": "mm/s"}
        assert told["settings"]["soft_limits"] == [mm(0), mm(120)]
        assert told["settings"]["acceleration"] == {"value": 10, "unit": "mm/s2"}, "a default, in mm"
        assert told["settings"]["run_current"] is None
        sources = told["sources"]
        assert [sources[key] for key in ("velocity", "acceleration", "run_current")] == [
            "file",
            "default",
            "module",
        ]
        by_setting = {one["setting"]: one for one in told["objects"]}
        assert by_setting["velocity"] | {"name": ""} == {
            "setting": "velocity", "index": "0x6081", "sub": 0, "name": "", "value": 102_400,
            "unit": "steps/s", "needs_disable": False,
        }  # fmt: skip
        assert by_setting["microsteps"]["needs_disable"] is True
        assert told["units"] == ["steps", "turns", "deg", "mm", "um", "µm", "μm"]
        assert told["revision"] == 0


async def test_a_patch_is_written_read_back_and_gone_by_at_once() -> None:
    async with running(settings_of()) as bench:
        await bench.until_ready()
        _, tag = await configuration(bench)
        body = {
            "velocity": "20 mm/s", "max_velocity": {"value": 30_000, "unit": "um/s"},
            "soft_limits": [mm(0), mm(50)], "run_current": {"value": 60, "unit": "%"},
        }  # fmt: skip
        response = await patch(bench, body, tag)
        assert response.status_code == 200, response.text
        told = response.json()
        assert {one["name"]: one["new"] for one in told["written"]} == {
            "Profile Velocity": 204_800, "Maximum Position Limit": 512_000, "Maximum current": 153,
        }  # fmt: skip
        assert (await held(bench, 0x2003), await held(bench, 0x6081)) == (153, 204_800)
        assert (told["revision"], told["sources"]["velocity"]) == (1, "revision")
        assert response.headers["etag"] != tag
        await bench.enable("x")
        too_far = await bench.post("/nodes/1/axes/x/move", {"target": 51, "unit": "mm"})
        assert too_far.status_code == 422
        too_fast = await bench.post("/nodes/1/axes/x/move", {"target": 1, "unit": "mm", "velocity": 31})
        assert (too_fast.status_code, too_fast.json()["errors"][0]["rule"]) == (422, "max_velocity")
        back = await patch(bench, {"velocity": None})
        assert back.json()["settings"]["velocity"]["value"] == 5, "the default, and not the file's"


async def test_a_change_is_made_from_what_is_there_or_not_at_all(bench: Bench) -> None:
    _, tag = await configuration(bench)
    assert (await patch(bench, {"homing_method": 17}, None)).json()["code"] == "precondition_required"
    assert (await patch(bench, {"homing_method": 17}, tag)).status_code == 200
    late = await patch(bench, {"homing_method": 18}, tag)
    assert (late.status_code, late.json()["code"]) == (412, "precondition_failed")
    assert (await configuration(bench))[0]["settings"]["homing_method"] == 17


STEPS_S = {"unit": "steps/s"}
BROKEN = [
    ({"end_velocity": {"value": 9} | STEPS_S}, "vstop_at_least_10"),
    ({"start_velocity": {"value": 11} | STEPS_S}, "vstop_at_least_vstart"),
    ({"ramp_d1": {"value": 0, "unit": "steps/s2"}}, "d1_not_0"),
    ({"ramp_d2": {"value": 0, "unit": "steps/s2"}}, "d2_not_0"),
    ({"ramp_v1": {"value": 5} | STEPS_S}, "v1_at_most_v2"),
    ({"ramp_v2": {"value": 5} | STEPS_S}, "a2_not_0"),
    ({"velocity": {"value": 2**24} | STEPS_S}, "range_of_rates"),
    ({"max_velocity": {"value": 100} | STEPS_S}, "max_velocity"),
    ({"run_current": {"value": 101, "unit": "%"}}, "range_2003h"),
    ({"standby_delay": {"value": 4.01, "unit": "s"}}, "range_2089h"),
    ({"homing_method": 4}, "range_6098h"),
    ({"encoder_direction": 2}, "range_200Bh"),
    ({"soft_limits": [{"value": 2, "unit": "steps"}, {"value": 1, "unit": "steps"}]}, "lower_below_upper"),
    ({"microsteps": 3}, "range_2000h"),
    ({"unit": "mm"}, None),
    ({"gear": "1:0"}, None),
    ({"unit": "mm", "gear": "3:1"}, "unit_follows_from_gearing"),
    ({"velocity": 5}, None),
    ({"velocity": {"value": 5, "unit": "mm/s"}}, None),
    ({"velocity": {"value": 5, "unit": "steps"}}, None),
    ({"velocity": {"value": -5} | STEPS_S}, None),
    ({"require_homing": "yes"}, None),
    ({"speed": 5}, None),
    ([], None),
]  # fmt: skip


async def test_what_breaks_a_rule_is_refused_by_its_name_and_changes_nothing(bench: Bench) -> None:
    told, tag = await configuration(bench)
    for body, rule in BROKEN:
        response = await patch(bench, body)
        assert response.status_code == 422, (body, response.text)
        problem = response.json()
        assert problem["hint"]
        if rule is not None:
            assert rule in [error["rule"] for error in problem["errors"]], problem
    assert (await configuration(bench))[0]["settings"] == told["settings"]
    assert (await configuration(bench))[1] == tag


async def test_a_moving_axis_keeps_its_settings_and_units_need_it_disabled() -> None:
    async with running(settings_of()) as bench:
        await bench.until_ready()
        await bench.enable("x")
        await bench.move(500_000, axis="x")
        await bench.until_moving()
        busy = await patch(bench, {"velocity": "1 mm/s"})
        assert (busy.status_code, busy.json()["code"]) == (409, "axis_busy")
        await bench.post("/nodes/1/axes/x/stop")
        for body in ({"pitch": "4 mm"}, {"unit": "um"}, {"switch_parameters": 3}):
            refused = await patch(bench, body)
            assert (refused.status_code, refused.json()["obstacles"][0]["code"]) == (409, "disable_first")
        await bench.post("/nodes/1/axes/x/disable")
        done = await patch(bench, {"pitch": "4 mm", "unit": "um"})
        assert done.json()["settings"]["velocity"] == {"value": 10, "unit": "mm/s"}, "as it was said"
        assert (await bench.axis("x"))["position"]["unit"] == "um"
        assert await held(bench, 0x6081) == 128_000


async def test_a_store_that_can_t_keep_them_leaves_the_old_ones(bench: Bench) -> None:
    before = await held(bench, 0x6081)

    async def full(*_: object) -> bool:
        return False

    bench.service.store.commit = full
    response = await patch(bench, {"velocity": "777 steps/s"})
    assert (response.status_code, response.json()["code"]) == (503, "history_off")
    assert await held(bench, 0x6081) == before
    assert (await configuration(bench))[0]["revision"] == 0
    del bench.service.store.commit
    assert (await patch(bench, {"velocity": "777 steps/s"})).json()["revision"] == 1


async def test_the_newest_revision_goes_over_the_file_at_the_next_start(tmp_path: Path) -> None:
    store = tmp_path / "canaxis.db"
    async with running(settings_of(store=store)) as bench:
        await bench.until_ready()
        await patch(bench, {"velocity": "20 mm/s", "run_current": {"value": 153, "unit": "1/255"}})
        await patch(bench, {"acceleration": "50 mm/s2"})
    changed = {**X, "unit": "um", "velocity": "3 mm/s", "homing_method": 19}
    async with running(settings_of(changed, store=store)) as bench:
        await bench.until_ready()
        told, _ = await configuration(bench)
        assert told["revision"] == 2
        assert told["settings"]["velocity"] == {"value": 20, "unit": "mm/s"}, (
            "mm/s whatever the file's unit is"
        )
        assert (told["settings"]["homing_method"], told["sources"]["homing_method"]) == (19, "file")
        assert (await held(bench, 0x6081), await held(bench, 0x2003)) == (204_800, 153)
        done = await bench.post("/settings/rollback", {"revision": 1})
        assert done.json()["revision"] == 3
        assert (await configuration(bench))[0]["sources"]["acceleration"] == "default"
        done = await bench.post("/settings/rollback", {"revision": 0})
        assert (await configuration(bench))[0]["settings"]["velocity"] == {"value": 3, "unit": "mm/s"}
        assert (await bench.post("/settings/rollback", {"revision": 99})).json()["code"] == "unknown_revision"
        listed = (await bench.get("/settings/revisions")).json()
        assert [(one["revision"], one["what"]) for one in listed["revisions"]] == [
            (4, "rollback"), (3, "rollback"), (2, "patch"), (1, "patch"),
        ]  # fmt: skip
        assert listed["revisions"][3]["who"] == "anonymous"
        assert listed["current"] == 4


async def test_kept_settings_that_no_longer_fit_leave_the_file_alone_and_say_so(tmp_path: Path) -> None:
    store = tmp_path / "canaxis.db"
    async with running(settings_of(store=store)) as bench:
        await bench.until_ready()
        await patch(bench, {"velocity": "20 mm/s"})
    async with running(settings_of({"name": "x"}, store=store)) as bench:  # no pitch: no mm any more
        await bench.until_ready()
        told, _ = await configuration(bench)
        assert "mm/s" in told["problem"]
        assert told["settings"]["velocity"] == {"value": 51_200, "unit": "steps/s"}
        assert (await patch(bench, {"velocity": "5 steps/s"})).json()["code"] == "history_off"
        assert (await bench.post("/settings/rollback", {"revision": 0})).json()["revision"] == 2
        assert (await configuration(bench))[0]["problem"] is None


async def test_a_document_is_exported_compared_and_applied_all_or_nothing() -> None:
    y = {"name": "y", "unit": "deg", "gear": "90:1", "velocity": "30 deg/s"}
    async with running(settings_of(X, y)) as bench:
        await bench.until_ready()
        exported = await bench.client.get("/api/v1/settings", headers={"Accept": "application/yaml"})
        assert exported.headers["content-type"].startswith("application/yaml")
        document = yaml.safe_load(exported.text)
        assert document["nodes"][0]["axes"][0]["velocity"] == "10 mm/s"
        assert document == (await bench.get("/settings")).json()
        assert (await bench.post("/settings/diff", document)).json()["equal"] is True
        assert (await bench.post("/settings/diff")).json()["equal"] is True

        document["nodes"][0]["axes"][0]["velocity"] = "15 mm/s"
        document["nodes"][0]["axes"][1]["run_current"] = "50 %"
        differs = (await bench.post("/settings/diff", document)).json()
        assert [(one["setting"], one["kept"]) for one in differs["fields"]] == [
            ("velocity", {"value": 10, "unit": "mm/s"}), ("run_current", None),
        ]  # fmt: skip
        assert [(one["index"], one["held"], one["wanted"]) for one in differs["objects"]] == [
            ("0x6081", 102_400, 153_600), ("0x2203", 128, 128),
        ][:1]  # fmt: skip
        applied = await bench.post("/settings/apply", document)
        assert applied.status_code == 200, applied.text
        assert [len(axis["written"]) for axis in applied.json()["axes"]] == [1, 0, 0]
        assert (await bench.post("/settings/diff", document)).json()["equal"] is True

        await bench.enable("y")
        document["nodes"][0]["axes"][0]["velocity"] = "16 mm/s"
        document["nodes"][0]["axes"][1]["switch_parameters"] = 3
        refused = await bench.post("/settings/apply", document)
        assert refused.status_code == 409
        assert await held(bench, 0x6081) == 153_600, "x wasn't touched either"
        document["nodes"][0]["model"] = "TMCM-1270"
        assert (await bench.post("/settings/apply", document)).status_code == 422


async def test_a_comparison_finds_what_somebody_else_wrote_and_who_can_t_be_asked() -> None:
    async with running(settings_of()) as bench:
        await bench.until_ready()
        node = bench.service.network.node(1)
        await node.write(Address(0x2013), 1234)
        found = (await bench.post("/settings/diff")).json()
        assert [(one["setting"], one["held"]) for one in found["objects"]] == [("ramp_d1", 1234)]
        assert found["fields"] == []
        bench.module.power_off()
        await bench.until(lambda: node.state.value == "lost")
        found = (await bench.post("/settings/diff")).json()
        assert [one["node"] for one in found["unread"]] == [1]
        assert (await patch(bench, {"velocity": "5 mm/s"})).status_code == 503


@pytest.mark.parametrize("path", ["store", "restore-defaults"])
async def test_the_module_s_memory_is_guarded(bench: Bench, path: str) -> None:
    await bench.enable("0")
    refused = await bench.post(f"/nodes/1/{path}", {"what": "all", "confirm": True})
    assert (refused.status_code, refused.json()["code"]) == (409, "not_ready")
    await bench.post("/nodes/1/axes/0/disable")
    for body in ({"what": "all"}, {"what": "all", "confirm": False}, {"what": "axis", "confirm": True}):
        assert (await bench.post(f"/nodes/1/{path}", body)).status_code == 422
    done = await bench.post(f"/nodes/1/{path}", {"what": "axis", "axis": "y", "confirm": True})
    assert (done.status_code, done.json()["axis"]) == (200, 1)
    unknown = await bench.post(f"/nodes/1/{path}", {"what": "axis", "axis": "q", "confirm": True})
    assert unknown.status_code == 404


async def test_what_is_stored_survives_a_power_cycle(bench: Bench) -> None:
    await patch(bench, {"run_current": {"value": 99, "unit": "1/255"}})
    await bench.post("/nodes/1/store", {"what": "all", "confirm": True})
    await bench.post("/settings/rollback", {"revision": 0})
    axis = bench.service.network.node(1).axis(0)
    lives = axis.lives
    bench.module.power_cycle()
    await bench.until(lambda: axis.lives > lives)
    await bench.until_ready()
    assert await held(bench, 0x2003) == 99
