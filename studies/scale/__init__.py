"""What it costs to grow: fusion processes simulated from measured costs, homes by factors of ten (docs/scale.md)."""
