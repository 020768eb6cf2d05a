"""The verb `effort`: how well Effort is told, on recordings whose trials say how they were done."""

import json as json_text
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput
from common.progress import ProgressBar

if TYPE_CHECKING:
    from studies.effort_study import Judged


def effort(
    archive: Annotated[Path, typer.Argument(help="The motion archive (.npz); trials such as -1_0_1_1.")],
    views: Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG], camera files; by commas.")],
    rule: Annotated[str, typer.Option(help="Name of the fusion rule.")] = "robust_inverse_entropy",
    rate: Annotated[float | None, typer.Option(min=1, help="Frames a second; what most recordings have.")] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for the tables and figures.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
) -> None:
    """Poles of Space, Weight, Time and Flow told apart, each action judged by what the other actions taught.

    Example: labanmesh effort effort.npz --views door,wheel --report out
    """
    from observer.geometry.views import parse_view, split_views
    from observer.learning import prepared
    from observer.motion.archive_file import read_archive
    from studies.effort_study import FRACTIONS, as_json, as_text, judge_poles

    whole = read_archive(archive)
    usual = Counter(r.rate_hz for r in whole.recordings).most_common(1)[0][0]
    whole = prepared(whole, (), rate or usual)
    seen = [parse_view(text) for text in split_views(views)]
    with ProgressBar() as bar:
        at = judge_poles(whole, seen, rule, FRACTIONS, bar)
    found = as_json(at, rule)
    text = as_text(found)
    print(text)
    written = [] if report is None else _report(report, text, at[1.0], found)
    if json is not None:
        _write(json, json_text.dumps(found, indent=1) + "\n", "--json")
        written.append(json)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _report(folder: Path, text: str, judged: "Judged", found: dict[str, Any]) -> list[Path]:
    from studies.report import figures

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"--report {folder}: {error.strerror}") from None
    _write(folder / "effort.txt", text + "\n", "--report")
    return [folder / "effort.txt", *(_drawn(figures(), judged, found, folder))]


def _drawn(figures: Any, judged: "Judged", found: dict[str, Any], folder: Path) -> list[Path]:  # noqa: ANN401 - a module
    from studies.effort_study import FUSED

    names = [*judged.views, FUSED]
    rates = {name: [by[name]["accuracy"] for by in found["factors"].values()] for name in names}
    series, ece = {}, {}
    for factor, by in found["factors"].items():
        p, truth = judged.poles(FUSED, factor)
        series[factor], ece[factor] = (p.max(axis=1), p.argmax(axis=1) == truth), by[FUSED]["ece"]
    return [
        figures.poles_figure(list(found["factors"]), rates, folder / "poles.png"),
        figures.reliability_figure(series, ece, folder / "reliability.png"),
    ]


def _write(path: Path, text: str, option: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{option} {path}: {error.strerror}") from None
