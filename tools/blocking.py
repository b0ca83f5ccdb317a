"""Write the blocking client, canaxis/blocking, anew from canaxis/asynchronous; why: docs/decisions/0026.

``python tools/blocking.py`` writes it, with ``--check`` it says what differs and ends with 1.

What is replaced is all here: `async` and `await` go, names that begin with ``Async`` lose that, a few have a
partner (NAMES), and what docstrings and comments say follows (TEXTS). Ruff sorts, formats and wraps.
"""

from __future__ import annotations

import argparse
import difflib
import io
import itertools
import re
import subprocess
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "canaxis" / "asynchronous"
TARGET = ROOT / "canaxis" / "blocking"
BY_HAND = {"__init__.py", "waiting.py"}
"""Files that each of the two has of its own."""
HEAD = "# Made by `make client` from canaxis/asynchronous/{name}: change that.\n"
NAMES = {
    "asynchronous": "blocking",
    "AnyPoints": "Points",
    "__aenter__": "__enter__",
    "__aexit__": "__exit__",
    "aclose": "close",
    "aclosing": "closing",
    "aiter_bytes": "iter_bytes",
    "aread": "read",
    "async_pieces": "pieces",
}
TEXTS = (
    (r"\b([Ff])or an event loop\b", r"\1or plain Python"),
    (r"\b([Aa])n `async with`", r"\1 `with`"),
    (r"`async with`", "`with`"),
    (r"\b([Aa])n `Async(?=[A-Z])", r"\1 `"),
    (r"\bAsync(?=[A-Z])", ""),
    (r"\btask(s?)\b", r"thread\1"),
)


def blocking(source: str) -> str:
    """Asynchronous source as a blocking one, not formatted yet."""
    tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    begins = [0]
    for line in source.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))
    made: list[str] = []
    done = 0
    for token, following in itertools.pairwise(tokens):
        start, end = (begins[row - 1] + column for row, column in (token.start, token.end))
        if token.type == tokenize.NAME and token.string in ("async", "await"):
            new, end = "", begins[following.start[0] - 1] + following.start[1]
        elif token.type == tokenize.NAME:
            new = NAMES.get(token.string) or re.sub(r"^Async(?=[A-Z])", "", token.string)
        elif token.type in (tokenize.STRING, tokenize.COMMENT):
            new = token.string
            for pattern, replacement in TEXTS:
                new = re.sub(pattern, replacement, new)
        else:
            continue
        made += source[done:start], new
        done = end
    return "".join(made) + source[done:]


def formatted(source: str, path: Path) -> str:
    """With its imports in order, shortened loops, and in the house's format."""
    steps = (
        ["check", "--fix-only", "--unsafe-fixes", "--select", "I,UP028"],
        ["format"],
    )
    for step in steps:
        command = [sys.executable, "-m", "ruff", *step, "--quiet", "--stdin-filename", str(path), "-"]
        done = subprocess.run(command, input=source, stdout=subprocess.PIPE, text=True, check=True, cwd=ROOT)
        source = done.stdout
    return source


def wanted() -> dict[Path, str]:
    """Every file that is made, and what it is to be."""
    sources = [path for path in sorted(SOURCE.glob("*.py")) if path.name not in BY_HAND]
    return {
        TARGET / path.name: formatted(HEAD.format(name=path.name) + blocking(path.read_text("utf-8")), path)
        for path in sources
    }


def found() -> dict[Path, str]:
    """Every file that was made before."""
    return {path: path.read_text("utf-8") for path in TARGET.glob("*.py") if path.name not in BY_HAND}


def differences() -> str:
    """Where the files are not what their sources make now; empty if they are."""
    now, then = wanted(), found()
    return "".join(
        line
        for path in sorted({*now, *then})
        for line in difflib.unified_diff(
            then.get(path, "").splitlines(keepends=True),
            now.get(path, "").splitlines(keepends=True),
            str(path.relative_to(ROOT)),
            "as its source makes it now",
        )
    )


def write() -> None:
    """Write every file, and remove those whose source is gone."""
    files = wanted()
    for path in found().keys() - files.keys():
        path.unlink()
    for path, text in files.items():
        path.write_text(text, "utf-8")


def main() -> int:
    """Returns the exit code."""
    parser = argparse.ArgumentParser(description="Write canaxis/blocking anew from canaxis/asynchronous.")
    parser.add_argument("--check", action="store_true", help="write nothing, fail if something differs")
    if not parser.parse_args().check:
        write()
        return 0
    print(different := differences(), end="")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
