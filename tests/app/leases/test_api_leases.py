"""Leases over HTTP: who may command, what stops when one ends, who is told."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import httpx
import pytest
from api_bench import Bench, EventClient, running
from fastapi.routing import APIRoute

from app.access.roles import DRY_RUNS, needs_lease
from app.axes.deps import every_axis, get_axis, get_node
from app.configuration.configuration import AuditConfiguration, Configuration
from app.leases.book import Lease
from app.leases.leases import LeaseEnd
from app.main import create_app
from app.operations.starting import get_starter

pytestmark = pytest.mark.looptime

X = {"node": "stage", "axis": "x"}
Y = {"node": 1, "axis": 1}


async def take(bench: Bench, *axes: dict[str, Any], **more: Any) -> dict[str, Any]:
    response = await bench.post("/leases", {"axes": list(axes or (X,)), **more})
    assert response.status_code == 201, response.text
    return response.json()


def under(lease: dict[str, Any]) -> dict[str, str]:
    return {"Lease": lease["token"]}


def turns(bench: Bench, axis: int) -> bool:
    """Whether the motor turns, whatever anybody believes."""
    return bench.module.apply(lambda module, _: module.axes[axis].moving)


def place(bench: Bench, axis: int) -> float:
    return bench.module.apply(lambda module, now: module.axes[axis].motor.place(now))


def refused(response: httpx.Response) -> str:
    assert response.status_code == 423, response.text
    return response.json()["code"]


async def test_what_a_lease_says(bench: Bench) -> None:
    response = await bench.post("/leases", {"axes": [X, Y], "ttl_s": 30, "owner": "scheduler 1"})
    lease = response.json()
    assert response.headers["location"] == lease["links"]["self"] == f"/api/v1/leases/{lease['id']}"
    assert [axis["name"] for axis in lease["axes"]] == ["x", "y"]
    assert (lease["owner"], lease["ttl_s"]) == ("scheduler 1", 30)
    assert 29 < lease["expires_in_s"] <= 30
    seen = (await bench.get("/leases")).json()["leases"]
    assert [each["id"] for each in seen] == [lease["id"]]
    assert "token" not in seen[0]
    assert lease["token"] not in (await bench.get(f"/leases/{lease['id']}")).text
    shown = (await bench.axis())["lease"]
    assert (shown["id"], shown["owner"]) == (lease["id"], "scheduler 1")
    assert (await bench.axis("2"))["lease"] is None


async def test_others_are_refused_and_the_holder_is_not(bench: Bench) -> None:
    lease = await take(bench, owner="anna", ttl_s=60)
    for verb in ("enable", "disable", "reset-fault", "move", "velocity", "home"):
        response = await bench.post(f"/nodes/1/axes/0/{verb}", {} if verb == "home" else None)
        assert refused(response) == "leased", verb
        assert response.json()["owner"] == "anna"
        assert 55 < response.json()["expires_in_s"] <= 60
        assert 55 < int(response.headers["retry-after"]) <= 60
    assert refused(await bench.post("/nodes/1/axes/0/enable", headers={"Lease": "old"})) == "lease_lost"
    assert (await bench.post("/nodes/1/axes/0/enable", headers=under(lease))).status_code == 200
    key = under(lease) | {"Idempotency-Key": "k"}
    body = {"target": 500, "unit": "steps"}
    assert (await bench.post("/nodes/1/axes/0/move?wait=20", body, headers=key)).status_code == 200
    await bench.enable("1")  # free
    assert refused(await bench.post("/nodes/1/axes/1/enable", headers={"Lease": "old"})) == "lease_lost"


async def test_commands_to_a_node_heed_the_leases_of_all_its_axes(bench: Bench) -> None:
    lease = await take(bench, Y)
    assert refused(await bench.post("/nodes/1/boot")) == "leased"
    assert refused(await bench.post("/nodes/1/verify-failsafe")) == "leased"
    assert refused(await bench.put("/nodes/1/objects/0x6065/0", {"value": 1})) == "leased"
    assert (await bench.post("/nodes/1/boot", headers=under(lease))).status_code == 200


async def test_no_way_past_a_lease_to_the_motor_or_the_module(bench: Bench) -> None:
    """Whatever is sent to several axes, to a module, or as settings."""
    await bench.enable()
    path = {"axes": [X | {"unit": "steps"}], "points": [{"t": t, "positions": [t]} for t in (0, 1)]}
    commands: list[tuple[str, str, Any]] = [
        ("POST", "/moves", {"targets": [X | {"target": 500, "unit": "steps"}]}),
        ("POST", "/trajectories", path),
        ("POST", "/nodes/1/axes/0/set-position", {"position": 5, "unit": "steps"}),
        ("PUT", "/nodes/1/axes/0/positions/park", {"position": 5, "unit": "steps"}),
        ("DELETE", "/nodes/1/axes/0/positions/park", None),
        ("PATCH", "/nodes/1/axes/0/settings", {"velocity": 77}),
        ("POST", "/settings/apply", {"nodes": [{"id": 1, "axes": [{"velocity": 77}]}]}),
        ("POST", "/settings/rollback", {"revision": 0}),
        ("POST", "/nodes/1/store", {"what": "all", "confirm": True}),
        ("POST", "/nodes/1/restore-defaults", {"what": "all", "confirm": True}),
        ("POST", "/nodes/1/outputs/0", {"on": True}),
    ]
    await take(bench, owner="anna")
    for method, where, body in commands:
        headers = {"Content-Type": "application/json"}
        response = await bench.client.request(method, f"/api/v1{where}", json=body, headers=headers)
        assert refused(response) == "leased", where
        assert response.json()["owner"] == "anna"
    assert (await bench.get("/operations")).json()["operations"] == []
    assert (turns(bench, 0), place(bench, 0)) == (False, 0)
    assert (await bench.get("/settings/revisions")).json()["revisions"] == []


async def test_a_stop_a_cancel_and_a_read_need_none(bench: Bench) -> None:
    lease = await take(bench)
    await bench.post("/nodes/1/axes/0/enable", headers=under(lease))
    move = {"target": 900_000, "unit": "steps"}
    for path in ("/nodes/1/axes/0/stop", "/operations/{id}/cancel", "/nodes/1/axes/0/quick-stop", "/stop"):
        operation = await bench.post("/nodes/1/axes/0/move", move, headers=under(lease))
        assert operation.status_code == 202, operation.text
        stopped = await bench.post(path.format(**operation.json()), headers={"Lease": "of nobody"})
        assert stopped.status_code == 200, stopped.text
        told = (await bench.get(f"/operations/{operation.json()['id']}")).json()
        assert told["state"] == "cancelled"
        if path.endswith("quick-stop"):
            await bench.post("/nodes/1/axes/0/enable", headers=under(lease))


async def test_when_it_expires_its_axes_are_stopped(bench: Bench) -> None:
    await bench.enable("0", "1")
    ended: list[tuple[Lease, LeaseEnd]] = []
    unwatch = bench.service.leases.watch(lambda lease, end: ended.append((lease, end)))
    lease = await take(bench, owner="anna", ttl_s=1)
    body = {"target": 9_000_000, "unit": "steps"}
    operation = (await bench.post("/nodes/1/axes/0/move", body, headers=under(lease))).json()
    free = (await bench.move(9_000_000, axis="1")).json()
    told = (await bench.get(f"/operations/{operation['id']}?wait=20")).json()
    assert told["state"] == "cancelled"
    assert "The lease of anna expired" in told["reason"]
    assert [(each.id, end) for each, end in ended] == [(lease["id"], LeaseEnd.EXPIRED)]
    unwatch()
    await bench.until(lambda: not turns(bench, 0), 5)
    assert turns(bench, 1), "what was free goes on"
    rest = place(bench, 0)
    await asyncio.sleep(5)
    assert place(bench, 0) == rest
    assert (await bench.axis())["state"] == "operation_enabled"
    assert (await bench.get(f"/operations/{free['id']}")).json()["state"] == "running"
    assert refused(await bench.post("/nodes/1/axes/0/enable", headers=under(lease))) == "lease_lost"
    assert refused(await bench.post(f"/leases/{lease['id']}/renew", headers=under(lease))) == "lease_lost"
    assert (await bench.get(f"/leases/{lease['id']}")).status_code == 404
    assert (await bench.post("/nodes/1/axes/0/enable")).status_code == 200


async def test_renewed_it_lasts(bench: Bench) -> None:
    lease = await take(bench, ttl_s=1)
    renewed = await bench.post(f"/leases/{lease['id']}/renew", {"ttl_s": 60}, headers=under(lease))
    assert 59 < renewed.json()["expires_in_s"] <= 60
    assert refused(await bench.post(f"/leases/{lease['id']}/renew")) == "leased"
    assert (await bench.get(f"/leases/{lease['id']}")).status_code == 200


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("method", ["POST", "DELETE"])
async def test_released_it_stops_what_runs_only_if_asked(bench: Bench, method: str, stop: bool) -> None:
    await bench.enable()
    lease = await take(bench)
    body = {"target": 9_000_000, "unit": "steps"}
    operation = (await bench.post("/nodes/1/axes/0/move", body, headers=under(lease))).json()
    await bench.until_moving()
    if method == "POST":
        released = await bench.post(f"/leases/{lease['id']}/release", {"stop": stop}, headers=under(lease))
    else:
        json = {"Content-Type": "application/json"}
        path = f"/api/v1/leases/{lease['id']}?stop={str(stop).lower()}"
        released = await bench.client.delete(path, headers=under(lease) | json)
    assert turns(bench, 0) is not stop, "where it stops it answers at standstill"
    assert (released.status_code, released.json()["expires_in_s"]) == (200, 0)
    told = (await bench.get(f"/operations/{operation['id']}")).json()
    assert told["state"] == ("cancelled" if stop else "running")
    assert (await bench.axis())["moving"] is not stop
    assert (await bench.axis())["lease"] is None


async def test_a_take_over_stops_what_runs_and_is_told_everywhere(tmp_path: Path) -> None:
    audit = tmp_path / "audit.log"
    async with running(Configuration(audit=AuditConfiguration(file=audit))) as bench:
        await bench.until_ready()
        await bench.enable("0", "1")
        hers = await take(bench, X, Y, owner="anna")
        body = {"target": 9_000_000, "unit": "steps"}
        operation = (await bench.post("/nodes/1/axes/1/move", body, headers=under(hers))).json()
        await bench.until_moving(1)
        assert refused(await bench.post("/leases", {"axes": [X], "owner": "bert"})) == "leased"
        async with EventClient(bench.app) as events:
            assert [each["id"] for each in (await events.next("snapshot")).data["leases"]] == [hers["id"]]
            his = await take(bench, X, owner="bert", force=True)
            over, taken = (await events.next("lease")).data, (await events.next("lease")).data
        assert his["fencing"] > hers["fencing"]
        assert (over["change"], over["by"], over["stopped"]) == ("taken_over", "bert", True)
        assert (over["lease"]["id"], taken["lease"]["id"]) == (hers["id"], his["id"])
        assert taken["change"] == "taken"
        assert hers["token"] not in str((over, taken))
        told = (await bench.get(f"/operations/{operation['id']}")).json()
        assert told["state"] == "cancelled"
        assert "bert took the lease of anna over" in told["reason"]
        assert not turns(bench, 1), "it answers at standstill"
        assert refused(await bench.post("/nodes/1/axes/1/enable", headers=under(hers))) == "lease_lost"
    entry = next(line for line in audit.read_text().splitlines() if "took_over" in line)
    assert '"from": "anna"' in entry
    assert '"for": "bert"' in entry
    assert hers["token"] not in audit.read_text()
    assert his["token"] not in audit.read_text()


async def test_what_waits_behind_a_lease_s_move_never_begins_once_it_expired(bench: Bench) -> None:
    await bench.enable()
    lease = await take(bench, owner="anna", ttl_s=1)
    body = {"target": 9_000_000, "unit": "steps", "on_busy": "queue"}
    sent = [(await bench.post("/nodes/1/axes/0/move", body, headers=under(lease))).json() for _ in range(3)]
    await bench.until_moving()
    await bench.until(lambda: not turns(bench, 0), 10)
    await asyncio.sleep(10)
    assert not turns(bench, 0)
    for operation in sent:
        told = (await bench.get(f"/operations/{operation['id']}")).json()
        assert told["state"] == "cancelled"
        assert (told["started"] is not None) is (operation is sent[0])


async def test_a_restart_forgets_leases_and_their_tokens() -> None:
    async with running() as bench:
        await bench.until_ready()
        lease = await take(bench, ttl_s=600)
    async with running() as again:
        await again.until_ready()
        assert refused(await again.post("/nodes/1/axes/0/enable", headers=under(lease))) == "lease_lost"
        assert (await again.get("/leases")).json()["leases"] == []
        newer = await take(again)
        assert newer["fencing"] > lease["fencing"]


async def test_a_lease_that_ends_while_the_record_is_written_begins_nothing(bench: Bench) -> None:
    await bench.enable()
    lease = await take(bench)
    commit = bench.service.store.commit

    async def meanwhile(*statements: Any) -> bool:
        await bench.service.leases.release(lease["id"], lease["token"])
        bench.service.store.commit = commit
        return await commit(*statements)

    bench.service.store.commit = meanwhile
    body = {"target": 100, "unit": "steps"}
    assert refused(await bench.post("/nodes/1/axes/0/move", body, headers=under(lease))) == "lease_lost"
    assert (await bench.get("/operations")).json()["operations"] == []


async def test_what_may_be_asked_for(bench: Bench) -> None:
    asked: list[tuple[int, dict[str, Any]]] = [
        (422, {}),
        (422, {"axes": [X], "node": "stage"}),
        (422, {"axes": []}),
        (422, {"axes": [X], "ttl_s": 0.5}),
        (422, {"axes": [X], "ttl_s": 3601}),
        (422, {"axes": [{"node": True, "axis": 0}]}),
        (404, {"axes": [{"node": 9, "axis": 0}]}),
        (404, {"axes": [{"node": 1, "axis": "w"}]}),
        (201, {"axes": [X, X]}),
        (201, {"node": "stage", "force": True}),
    ]
    for status, body in asked:
        response = await bench.post("/leases", body)
        assert response.status_code == status, response.text
        if "force" in body:
            assert [axis["name"] for axis in response.json()["axes"]] == ["x", "y", "z"]


NO_AXIS = {
    "diff_settings",
    "reset_stop",
    "issue_ticket",
    "take_lease",
    "renew_lease",
    "release_lease",
    "delete_lease",
}


def test_every_command_about_axes_looks_for_leases() -> None:
    """By the axis or node of its path (`axes.deps`), or as an operation on axes (`operations.starting`)."""

    def looks(dependant: Any) -> bool:
        calls = (get_axis, get_node, every_axis, get_starter)
        return any(each.call in calls or looks(each) for each in dependant.dependencies)

    routes = [each for each in create_app(Configuration()).routes if isinstance(each, APIRoute)]
    commands = [
        each
        for each in routes
        if any(needs_lease(method, each.path) for method in each.methods or ())
        and not each.path.endswith("/cancel")
    ]
    assert all(423 in each.responses for each in commands if looks(each.dependant))
    assert {each.name for each in commands if not looks(each.dependant)} == NO_AXIS


def test_what_a_dry_run_makes_a_look_are_the_routes_that_have_one() -> None:
    routes = [each for each in create_app(Configuration()).routes if isinstance(each, APIRoute)]
    have = {each.path for each in routes if any(p.alias == "dry_run" for p in each.dependant.query_params)}
    assert have == DRY_RUNS


async def test_a_dry_run_needs_no_lease_and_nothing_else_passes_for_one(bench: Bench) -> None:
    await bench.enable()
    await bench.post("/leases", {"node": 1, "owner": "anna", "ttl_s": 60}, headers={})
    move = {"target": 1000, "unit": "steps"}
    together = {"targets": [{"node": 1, "axis": 0, **move}]}
    for path, body in (("/nodes/1/axes/0/move", move), ("/moves", together), ("/nodes/1/axes/0/home", {})):
        assert (await bench.post(f"{path}?dry_run=true", body)).status_code == 200, path
        for query in ("", "?dry_run=false", "?dry_run=off", "?dry_run=true&dry_run=false"):
            assert (await bench.post(f"{path}{query}", body)).status_code == 423, (path, query)
    assert (await bench.post("/nodes/1/axes/0/disable?dry_run=true")).status_code == 423


async def test_a_busy_axis_says_when_it_is_likely_free(bench: Bench) -> None:
    await bench.enable()
    operation = (await bench.move(200_000)).json()
    motion = bench.service.operations.live(operation["id"])
    assert motion is not None
    await bench.until(lambda: (motion.motion.progress or 0) > 0.3)
    busy = await bench.move(0)
    assert busy.status_code == 409
    assert busy.json()["operation"].endswith(operation["id"])
    assert 1 <= int(busy.headers["retry-after"]) < 60
