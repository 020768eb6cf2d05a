"""What it costs to grow: fusion processes simulated from measured costs, and homes by factors of ten."""
