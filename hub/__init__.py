"""Who listens: the terminal view today; home bridges, dashboard and metrics later."""
