"""`python -m benchmarks.crowd`: a thousand SIMULATED observers before real fusion processes, told every ten seconds."""

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.crowd.trial import Plan, run
from common.errors import LabanmeshError


def main() -> int:
    """Runs it and prints what came of it; exit status 1 when a verdict was lost or doubled."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.crowd", description=__doc__)
    parser.add_argument("--scenes", type=int, default=250, help="each with four observers (default 250)")
    parser.add_argument("--rate", type=float, default=30.0, help="posteriors a second of each observer (default 30)")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--processes", type=int, default=1, help="fusion processes that share the scenes (default 1)")
    parser.add_argument("--kill", action="store_true", help="kill one in the middle, and start another later")
    given = parser.parse_args()
    plan = Plan(given.scenes, given.rate, given.minutes * 60, given.processes, given.kill)
    try:
        with tempfile.TemporaryDirectory() as folder:
            outcome = run(plan, Path(folder), lambda line: print(line, file=sys.stderr, flush=True))
    except LabanmeshError as error:
        print(f"crowd: {error}", file=sys.stderr)
        return error.exit_status
    print(outcome.table())
    return 0 if outcome.whole else 1


if __name__ == "__main__":
    sys.exit(main())
