"""The model file: a .npz without pickles, described in docs/design/model.md.

`header` is a JSON text (format version, kind, vocabulary, view, matrix, rate, body parts, parameters, provenance,
certainty); every other array is the model's own.
"""

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.model.base import Header, MovementModel
from observer.model.posterior_calibration import PosteriorCalibration
from observer.model.registry import MODELS
from observer.npz_file import read_arrays, write_whole

FORMAT = 1


def write_model(path: Path, model: MovementModel) -> None:
    """Write whole or not at all; raises BadInput when the folder cannot be written."""
    header = np.array(json.dumps(_as_json(model.header), indent=1))
    try:
        write_whole(path, {"header": header, **model.arrays()}, compressed=True)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None


def read_model(path: Path) -> MovementModel:
    """Read a model file; raises BadInput with one line for anything that is not one."""
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise BadInput(f"{path}: no such model file; make one with labanmesh learn") from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: not a model file ({error}); make one with labanmesh learn") from None
    if "header" not in arrays:
        raise BadInput(f"{path}: no model file: it has no 'header', as labanmesh learn writes it")
    try:
        said = json.loads(str(arrays.pop("header")))
        if said["format"] != FORMAT:
            raise BadInput(f"{path}: model format {said['format']}, this labanmesh reads {FORMAT}: learn it again")
        if said["kind"] not in MODELS:
            raise BadInput(f"{path}: model kind {said['kind']!r} is unknown; known: {', '.join(MODELS)}")
        kind, header = MODELS[said["kind"]], _from_json(said)
        missing = [name for name in kind.DEFAULTS if name not in header.parameters]
        if missing:
            raise BadInput(f"{path}: its header lacks the parameter {missing[0]!r}; learn it again")
        return kind.from_arrays(header, arrays)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(f"{path}: damaged model file ({type(error).__name__}: {error}); learn it again") from None


def require(path: Path, model: MovementModel, vocabulary: Vocabulary | None, rate_hz: float | None) -> None:
    """Raise BadInput when the model is for another vocabulary than the scene, or another rate than a given one."""
    header = model.header
    if vocabulary is not None and header.vocabulary.digest != vocabulary.digest:
        theirs, ours = ", ".join(header.vocabulary.labels), ", ".join(vocabulary.labels)
        raise BadInput(f"{path}: learned for the vocabulary [{theirs}], the scene has [{ours}]: learn it again")
    if rate_hz is not None and abs(header.rate_hz - rate_hz) > 0.01 * rate_hz:
        raise BadInput(
            f"{path}: learned at {header.rate_hz:g} Hz, the source gives {rate_hz:g} Hz: "
            f"labanmesh learn ... --rate {rate_hz:g}"
        )


def _as_json(header: Header) -> dict[str, Any]:
    background = {} if header.background is None else {"background": list(header.background)}
    return {
        "format": FORMAT,
        "kind": header.kind,
        "vocabulary": {
            "name": header.vocabulary.name,
            "hash": header.vocabulary.digest,
            "labels": list(header.vocabulary.labels),
        },
        "view": header.view,
        "matrix": header.matrix.tolist(),
        "rate_hz": header.rate_hz,
        "body_parts": list(header.body_parts),
        "parameters": dict(header.parameters),
        "provenance": dict(header.provenance),
        "certainty": asdict(header.certainty),
        **background,
    }


def _from_json(said: dict[str, Any]) -> Header:
    words = said["vocabulary"]
    return Header(
        kind=said["kind"],
        vocabulary=Vocabulary(tuple(words["labels"]), words["name"]),
        view=said["view"],
        matrix=np.array(said["matrix"], dtype=np.float64).reshape(3, 4),
        rate_hz=float(said["rate_hz"]),
        body_parts=tuple(said["body_parts"]),
        parameters={name: float(value) for name, value in said["parameters"].items()},
        provenance={name: str(value) for name, value in said["provenance"].items()},
        certainty=_certainty(said.get("certainty", {})),
        background=tuple(str(label) for label in said["background"]) if "background" in said else None,
    )


def _certainty(said: dict[str, Any]) -> PosteriorCalibration:
    numbers = {name: float(said[name]) for name in ("temperature", "doubt", "unlike", "slope") if name in said}
    return PosteriorCalibration(
        **numbers, foreseen=tuple((float(mean), float(spread)) for mean, spread in said.get("foreseen", ()))
    )
