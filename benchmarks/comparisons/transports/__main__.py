"""See commands.py. Empty but for this, because every process of a run imports it."""

if __name__ == "__main__":
    import sys

    from benchmarks.command_line import run_command
    from benchmarks.comparisons.transports.commands import transports

    sys.exit(run_command(transports, "comparisons.transports"))
