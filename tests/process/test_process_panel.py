"""The fault panel and `canaxis eds check` as processes: what a user types, and what they answer."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest
from repository import ROOT

from drivers.devices.catalog import Catalog
from drivers.devices.eds import build_eds
from drivers.sim.panel import COMMANDS

pytestmark = pytest.mark.process

GUIDE = ROOT / "docs" / "testing-with-the-simulator.md"
GUIDED = ("port", "faults", "service", "shared", "wire")
CANAXIS = (sys.executable, "-m", "app")
PYTEST = (sys.executable, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider", "-c", os.devnull)


class Simulator(NamedTuple):
    port: int
    panel: str


@pytest.fixture
def simulator(tmp_path: Path) -> Iterator[Simulator]:
    command = [*CANAXIS, "simulate", "--port", "0", "--nodes", "1,3", "--panel-port", "0", "--store"]
    process = subprocess.Popen([*command, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        panel = re.match(
            r"fault panel on (http://127\.0\.0\.1:\d+)/panel/v1/nodes", process.stdout.readline()
        )
        where = re.match(r"simulated module listens on 127\.0\.0\.1:(\d+)", process.stdout.readline())
        assert panel
        assert where
        yield Simulator(int(where[1]), panel[1])
    finally:
        process.send_signal(signal.SIGTERM)
        rest, _ = process.communicate(timeout=20)
    assert (process.returncode, rest) == (0, "")


def check(simulator: Simulator, *arguments: str) -> subprocess.CompletedProcess[str]:
    bus = ("--interface", "socketcand", "--channel", "can0", "--option", "host=127.0.0.1")
    return subprocess.run(
        [*CANAXIS, "eds", "check", *bus, "--option", f"port={simulator.port}", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ | {"COLUMNS": "200"},
    )


def test_a_lab_without_hardware(simulator: Simulator) -> None:
    with httpx.Client(base_url=simulator.panel) as http:
        assert [node["node"] for node in http.get("/panel/v1/nodes").json()["nodes"]] == [1, 3]
        pressed = http.post("/panel/v1/nodes/3/press_switch", json={"axis": 2, "switch": "negative"})
        assert pressed.json()["axes"][2]["switches"] == ["negative"]
        assert http.post("/panel/v1/nodes/3/press_switch", json={"axis": 9}).status_code == 422
        assert http.get("/docs").status_code == 200

        agrees = check(simulator, "--node", "1", "--json")
        report = json.loads(agrees.stdout)
        assert (agrees.returncode, report["agrees"], report["differences"]) == (0, True, [])
        assert report["checked"] == len(Catalog.load().profile("TMCM-3216").objects)

        lost = {"cob_id": "0x583", "byte": 4, "bits": 1}
        assert http.post("/panel/v1/nodes/3/corrupt_frames", json=lost).status_code == 200
        differs = check(simulator, "--node", "3", "--model", "TMCM-3216")
        assert differs.returncode == 1, differs.stderr
        assert re.search(r"1018h:1 .*Vendor ID.* constant .*646 \(286h\).* 647 \(287h\)", differs.stdout)

        http.post("/panel/v1/nodes/3/power_off", json={})
        gone = check(simulator, "--node", "3")
        assert (gone.returncode, gone.stdout) == (2, "")
        assert "canaxis: node 3 does not answer" in gone.stderr


def test_the_demo_has_the_panel_and_says_where() -> None:
    demo = subprocess.Popen(
        [*CANAXIS, "demo", "--port", "0", "--can-port", "0"], stdout=subprocess.PIPE, text=True
    )
    assert demo.stdout is not None
    try:
        for line in demo.stdout:
            if found := re.match(r"  fault panel +(http://127\.0\.0\.1:\d+/panel/v1/nodes)", line):
                break
        else:
            pytest.fail(f"the demo ended with {demo.wait()} and told of no panel")
        pressed = httpx.post(f"{found[1]}/1/press_switch", json={"axis": 0, "switch": "home"})
        assert pressed.json()["axes"][0]["switches"] == ["home"]
    finally:
        demo.send_signal(signal.SIGINT)
        demo.communicate(timeout=30)
    assert demo.returncode == 0


def test_the_eds_is_printed_and_written(tmp_path: Path) -> None:
    wanted = build_eds(Catalog.load().profile("TMCM-3216"))
    file = tmp_path / "module.eds"
    subprocess.run([*CANAXIS, "eds", "export", "--output", str(file)], check=True, timeout=60)
    assert file.read_text(encoding="ascii") == wanted
    printed = subprocess.run([*CANAXIS, "eds", "print"], check=True, capture_output=True, timeout=60)
    assert printed.stdout.decode() == wanted


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("eds", "print", "--model", "TMCM-1"), "--model TMCM-1: known are TMCM-3216"),
        (("eds", "export", "--output", "/nonexistent/x.eds"), "No such file or directory"),
        (("eds", "check", "--option", "port=1"), "canaxis: "),
        (("simulate", "--interface", "virtual", "--panel-port", "0"), "leave --interface out"),
    ],
)
def test_what_a_user_can_mend_is_told_in_a_line(arguments: tuple[str, ...], told: str) -> None:
    ended = subprocess.run([*CANAXIS, *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2
    assert told in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.timeout(240)
def test_the_guide_runs_as_it_is_printed(tmp_path: Path) -> None:
    files = dict(re.findall(r'^```python title="([a-z_]+\.py)"\n(.*?)^```$', GUIDE.read_text(), re.M | re.S))
    assert set(files) == {"conftest.py", *(f"test_{name}.py" for name in GUIDED)}
    for name, text in files.items():
        tmp_path.joinpath(name).write_text(text)
    tests = subprocess.run(
        [*PYTEST, str(tmp_path)],
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        cwd=tmp_path,
    )
    wanted = sum(text.count("def test_") for text in files.values())
    assert f"{wanted} passed" in tests.stdout, tests.stdout + tests.stderr


def test_the_guide_names_every_command() -> None:
    table = [line for line in GUIDE.read_text().splitlines() if line.startswith("| ")]
    named = [name for line in table for name in re.findall(r"`(\w+)`", line)]
    assert sorted(named) == sorted(COMMANDS)
