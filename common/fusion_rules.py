"""The default fusion rule, and those that are gone. The others are in fusion/engine/rules.py. Pure."""

DEFAULT_RULE = "guarded_product"
RETIRED_RULES = {
    "robust_inverse_entropy": DEFAULT_RULE, "robust_product": "product", "iest": "inverse_entropy",
    "ieat": "inverse_entropy", "median": "log", "chernoff": "log",
}  # fmt: skip
"""Rules of earlier versions, and what stands in for them."""
