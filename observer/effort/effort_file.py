"""The Effort model's file: a .npz without pickles, beside the movement model's (docs/design/effort.md)."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.effort.features import FEATURE_NAMES
from observer.effort.model import FACTOR_FEATURES, FACTORS, EffortModel
from observer.files import read_arrays, write_arrays
from observer.model.base import array_in

FORMAT_HEADER = {
    "format": 1,
    "features": list(FEATURE_NAMES),
    "evidence": {factor: list(names) for factor, names in FACTOR_FEATURES.items()},
}
"""What the header of a file of this version says."""
LEARN_EFFORT = "make one with labanmesh learn ... --effort"


def write_effort(path: Path, model: EffortModel) -> None:
    """Write the model, completely or not at all; raises BadInput or LabanmeshError as `write_arrays` does."""
    header = {
        **FORMAT_HEADER,
        "kind": "effort",
        "view": model.view,
        "rate_hz": model.rate_hz,
        "body_parts": list(model.body_parts),
        "provenance": dict(model.provenance),
    }
    arrays: dict[str, NDArray[Any]] = {
        "mean": model.mean,
        "deviation": model.deviation,
        "examples": model.examples.astype(np.float32),
        "levels": model.levels.astype(np.int8),
        "temper": model.temper,
        **{f"spread_{factor}": model.spreads[factor] for factor in FACTORS},
    }
    write_arrays(path, {"header": np.array(json.dumps(header, indent=1)), **arrays}, compressed=True)


def read_effort(path: Path) -> EffortModel:
    """Read an Effort model; raises BadInput, one line with the reason, for anything else."""
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise BadInput(f"{path}: no such Effort model; {LEARN_EFFORT}") from None
    except ValueError as error:
        raise BadInput(f"{path}: not an Effort model ({error}); {LEARN_EFFORT}") from None
    try:
        header = json.loads(str(arrays["header"]))
        if header["kind"] != "effort":
            raise BadInput(f"{path}: a model of kind {header['kind']!r}, an Effort model is expected; {LEARN_EFFORT}")
        if any(header[name] != value for name, value in FORMAT_HEADER.items()):
            raise BadInput(f"{path}: learned by another version (format, features); {LEARN_EFFORT}")
        return _model_of(header, arrays)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise BadInput(f"{path}: damaged Effort model ({reason}); {LEARN_EFFORT}") from None


def _model_of(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> EffortModel:
    """Raises ValueError for arrays of other shapes, and for numbers that are not finite."""
    n, d, rate_hz = len(arrays["levels"]), len(FEATURE_NAMES), float(header["rate_hz"])
    if not 0 < rate_hz < math.inf:
        raise ValueError(f"rate_hz is {rate_hz:g}, a positive, finite rate is expected")
    sizes = {factor: len(names) for factor, names in FACTOR_FEATURES.items()}
    return EffortModel(
        view=str(header["view"]),
        rate_hz=rate_hz,
        body_parts=tuple(header["body_parts"]),
        mean=array_in(arrays, "mean", (d,), np.float64),
        deviation=array_in(arrays, "deviation", (d,), np.float64),
        examples=array_in(arrays, "examples", (n, d), np.float64),
        levels=array_in(arrays, "levels", (n, len(FACTORS)), np.int64),
        spreads={f: array_in(arrays, f"spread_{f}", (sizes[f], sizes[f]), np.float64) for f in FACTORS},
        temper=array_in(arrays, "temper", (len(FACTORS),), np.float64),
        provenance={name: str(value) for name, value in header["provenance"].items()},
    )


def require_rate(path: Path, model: EffortModel, rate_hz: float) -> None:
    """Raise BadInput if the model was learned at another rate than the movement model."""
    if abs(model.rate_hz - rate_hz) > 0.01 * rate_hz:
        raise BadInput(
            f"{path}: learned at {model.rate_hz:g} Hz, the movement model at {rate_hz:g} Hz: "
            f"labanmesh learn ... --effort --rate {rate_hz:g}"
        )
