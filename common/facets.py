"""Facets: how a movement is performed, each facet a distribution over a few values. Pure.

They are Laban's Effort factors, each with its two poles, and his Shape in three directions. The order of the values is
their order in messages. An observer may also send facets of its own, within the limits of posterior.py.
"""

from collections.abc import Mapping

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
