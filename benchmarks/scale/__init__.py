"""The cost of growth: fusion processes simulated from measured costs, by factors of ten (docs/design/scale.md)."""
