"""Facets: what else is believed of a movement beside its name, each a distribution over a few named values.

Laban's Effort factors with their two poles, and his Shape in three directions. The order of the values is the order on
the wire.
"""

from collections.abc import Mapping, Sequence

SUM_TOLERANCE = 1e-3

EFFORT: Mapping[str, tuple[str, str]] = {
    "effort_time": ("sustained", "sudden"),
    "effort_weight": ("light", "strong"),
    "effort_space": ("indirect", "direct"),
    "effort_flow": ("free", "bound"),
}
SHAPE: Mapping[str, tuple[str, str, str]] = {
    "shape_horizontal": ("enclosing", "neither", "spreading"),
    "shape_vertical": ("sinking", "neither", "rising"),
    "shape_sagittal": ("retreating", "neither", "advancing"),
}
FACETS: Mapping[str, tuple[str, ...]] = {**EFFORT, **SHAPE}


def check_facets(facets: Mapping[str, Sequence[float]]) -> None:
    """Raise ValueError for a known facet of another length, or any that does not sum to 1; unknown ones may come."""
    for name, p in facets.items():
        if name in FACETS and len(p) != len(FACETS[name]):
            raise ValueError(f"facet {name} has {len(p)} values, {', '.join(FACETS[name])} are {len(FACETS[name])}")
        if abs(sum(p) - 1) > SUM_TOLERANCE:
            raise ValueError(f"facet {name} sums to {sum(p):.6g}, not to 1")
