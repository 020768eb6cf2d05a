"""The command line of the comparison: rounds over all transports by turns, to a table and a file of figures."""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.transports.kinds import KINDS, here, program
from benchmarks.transports.stage import flooded, judgement, paced, posteriors, processors
from benchmarks.transports.table import BEGIN, END, RUNS, Figure, Found, as_markdown, over_rounds, rewritten
from common.errors import BadInput, LabanmeshError
from common.progress import ProgressBar
from common.text import one_of, split_list

ROUNDS = 5
FRAMES = 180
SECONDS = 2.0
RESULT = Path("build/transports.json")
PACKAGES = {"zenoh": "eclipse-zenoh", "paho": "paho-mqtt", "nats": "nats-py", "zmq": "pyzmq"}


def main(words_given: Sequence[str] | None = None) -> int:
    """All runs; returns the exit status."""
    asked = _asked(words_given)
    try:
        text = _page(asked.page)
        names, left_out = here([one_of("--only", name, list(KINDS)) for name in split_list("--only", asked.only)])
        for line in left_out:
            print(line, file=sys.stderr)
        figures = measured(names, asked.rounds, asked.frames, asked.seconds)
        table = as_markdown(figures, _facts(names, asked.rounds), left_out)
        _write(asked.json, json.dumps(_as_json(figures, asked.rounds), indent=1) + "\n")
        if asked.page:
            _write(asked.page, rewritten(text, table) or text)
    except LabanmeshError as error:
        print(f"transports: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return 130
    print(table)
    return 0


def measured(names: Sequence[str], rounds: int, frames: int, seconds: float) -> dict[str, dict[str, Figure]]:
    """By transport and figure; in each round all take turns, and turns who begins."""
    found: dict[str, list[Found]] = {name: [] for name in names}
    total = rounds * len(names)
    with ProgressBar() as bar:
        for number in range(total):
            name = names[(number + number // len(names)) % len(names)]
            found[name] += _once(name, frames, seconds)
            bar("transports", number + 1, total)
    return {name: over_rounds(some) for name, some in found.items()}


def _once(name: str, frames: int, seconds: float) -> Iterator[Found]:
    """Each run of the table, once; its figures under its own name."""
    for run in RUNS:
        if run.paced:
            found = paced(name, run.publishers, run.listeners, frames)
        else:
            found = flooded(name, run.publishers, seconds)
        yield {f"{run.name}/{figure}": value for figure, value in found.items()}


def _facts(names: Sequence[str], rounds: int) -> str:
    """What was measured, on what, with which versions: one paragraph."""
    sizes = ", ".join(f"{len(judgement(count)):,} bytes with {count}" for count in sorted({r.publishers for r in RUNS}))
    libraries = [PACKAGES[library] for library in dict.fromkeys(KINDS[name].library for name in names)]
    brokers = [KINDS[name].broker for name in names if KINDS[name].broker]
    versions = [*(f"{name} {_version(name)}" for name in libraries), *(f"{n} {_broker_version(n)}" for n in brokers)]
    return (
        f"{processors()} processors; {rounds} rounds; a posterior of {len(posteriors('cam1', 0)[0])} bytes; a "
        f"judgement of {sizes} publishers. {', '.join(versions)}."
    )


def _version(package: str) -> str:
    with suppress(PackageNotFoundError):
        return version(package)
    return "unknown"


def _broker_version(name: str) -> str:
    option = "-h" if name == "mosquitto" else "--version"
    said = subprocess.run([program(name) or name, option], capture_output=True, text=True, check=False)  # noqa: S603
    found = re.search(r"\d+\.\d+\.\d+", said.stdout)
    return found[0] if found else "unknown"


def _as_json(figures: dict[str, dict[str, Figure]], rounds: int) -> dict[str, object]:
    told = {name: {key: asdict(figure) for key, figure in some.items()} for name, some in figures.items()}
    return {"version": 1, "rounds": rounds, "processors": processors(), "transports": told}


def _asked(words_given: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.transports", description=__doc__)
    parser.add_argument("--only", default=",".join(KINDS), help=f"by commas, of {', '.join(KINDS)}")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"by default {ROUNDS}: some fifteen minutes")
    parser.add_argument("--frames", type=int, default=FRAMES, help="posteriors of each publisher in a run at 60 Hz")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of a run as fast as they can")
    parser.add_argument("--json", type=Path, default=RESULT, help="file for the figures")
    parser.add_argument("--page", type=Path, help="a page in markdown whose table is written anew")
    return parser.parse_args(words_given)


def _page(page: Path | None) -> str:
    """The page as it is, looked at before the work and not after it."""
    if page is None:
        return ""
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--page {page}: cannot be read: {error.strerror}") from None
    if rewritten(text, "") is None:
        raise BadInput(f"--page {page}: the table goes between two lines that are not there: {BEGIN} and {END}")
    return text


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
