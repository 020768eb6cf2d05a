"""All movement models by name."""

from collections.abc import Mapping
from typing import cast

from common.errors import BadInput
from common.plugins import plugin, plugins
from common.text import nearest
from observer.model.base import MovementModel
from observer.model.phase import Phase
from observer.model.stacked import Stacked
from observer.model.symbol_tables import FrameTable

MODELS: Mapping[str, type[MovementModel]] = {model.kind: model for model in (Phase, FrameTable, Stacked)}
DEFAULT_MODEL = Stacked.kind


def find_model(kind: str) -> type[MovementModel] | None:
    """The model of that name, ours or of an installed package; None for an unknown one."""
    model = MODELS.get(kind) or plugin("models", kind)
    return cast("type[MovementModel]", model) if hasattr(model, "from_arrays") else None


def model_named(kind: str) -> type[MovementModel]:
    """The model of that name; raises BadInput with a suggestion for an unknown one."""
    model = find_model(kind)
    if model is None:
        raise BadInput(f"model = {kind!r}: unknown; {nearest(kind, (*MODELS, *plugins('models')))}")
    return model
