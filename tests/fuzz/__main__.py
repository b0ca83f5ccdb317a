"""Every hypothesis test as a fuzz target: run by name, guided by coverage, or replayed from one file.

``python -m tests.fuzz`` lists the targets, ``python -m tests.fuzz TARGET FILE`` replays what a run found, and
``python -m tests.fuzz TARGET --seconds 60`` looks for more, which alone needs atheris (``make fuzz``). A
target is any test of `MODULES` that takes nothing but what `given` draws.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
TESTS = HERE.parent
CORPUS = TESTS.parent / ".fuzz"
FOLDERS = ("kits", "fuzz", "app", "drivers/bus", "drivers/cia301", "drivers/cia402", "drivers/sim")
MODULES = (
    "test_fuzz_devices",
    "test_fuzz_face",
    "test_fuzz_master",
    "test_fuzz_sdo",
    "test_fuzz_sim",
    "test_fuzz_socketcand",
    "test_property_cia301_codecs",
    "test_property_cia301_sdo",
    "test_property_cia402_power",
    "test_bus_controller",
    "test_bus_socketcand_text",
    "test_sim_core_fuzz",
)

Target = Callable[[bytes], bytes | None]


def atheris() -> Any:
    """The fuzzer, which `make fuzz` alone installs; the stubs that pyright brings for it are not whole."""
    return importlib.import_module("atheris")


def targets(*, instrumented: bool = False) -> dict[str, Target]:
    """What takes bytes and raises if they show a bug, by name."""
    sys.path[:0] = [str(TESTS / folder) for folder in FOLDERS]
    context: Any = nullcontext()
    if instrumented:
        context = atheris().instrument_imports(include=["app", "drivers"])
    found: dict[str, Target] = {}
    with context:
        for module in map(importlib.import_module, MODULES):
            for name, value in vars(module).items():
                hypothesis = getattr(value, "hypothesis", None)
                if name.startswith("test_") and hypothesis is not None and not hasattr(value, "pytestmark"):
                    found[name.removeprefix("test_")] = hypothesis.fuzz_one_input
    return found


def chosen(name: str, *, instrumented: bool = False) -> Target:
    """The target of this name; ends the program if there is none."""
    known = targets(instrumented=instrumented)
    if name not in known:
        raise SystemExit(f"There is no target {name}. There are:\n" + "\n".join(sorted(known)))
    return known[name]


def explore(name: str, seconds: int) -> None:
    """Look for inputs that break a target, guided by coverage; never returns."""
    fuzzer = atheris()
    target = chosen(name, instrumented=True)
    corpus, crashes = CORPUS / name, CORPUS / "crashes"
    for folder in (corpus, crashes):
        folder.mkdir(parents=True, exist_ok=True)

    def once(data: bytes) -> None:
        try:
            target(data)
        except BaseException:
            file = crashes / f"{name}.bin"
            file.write_bytes(data)
            print(
                f"\nReplay it with: python -m tests.fuzz {name} {file.relative_to(TESTS.parent)}", flush=True
            )
            raise

    options = [f"-max_total_time={seconds}", "-max_len=4096", "-timeout=60", "-print_final_stats=1"]
    fuzzer.Setup([sys.argv[0], str(corpus), f"-artifact_prefix={crashes}/{name}-", *options], once)
    fuzzer.Fuzz()


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz targets of the tests.")
    parser.add_argument("target", nargs="?", help="name of a target, or `all`; all are listed if left out")
    parser.add_argument("file", nargs="?", type=Path, help="an input to replay")
    parser.add_argument("--seconds", type=int, help="look for inputs that break it, for so long")
    given = parser.parse_args()
    if given.target is None:
        print("\n".join(sorted(targets())))
    elif given.file is not None:
        chosen(given.target)(given.file.read_bytes())
        print("It holds.")
    elif given.target == "all":
        broken = [
            name
            for name in sorted(targets())
            if subprocess.call(
                [sys.executable, "-m", "tests.fuzz", name, "--seconds", str(given.seconds or 60)]
            )
        ]
        raise SystemExit("Broken: " + ", ".join(broken) if broken else 0)
    else:
        explore(given.target, given.seconds or 60)


if __name__ == "__main__":
    main()
