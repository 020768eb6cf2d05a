"""See commands.py. Empty but for this, because every process of a run imports it."""

if __name__ == "__main__":
    import sys

    from benchmarks.comparisons.transports.commands import main

    sys.exit(main())
