"""Runs a verb of labanmesh on a machine whose clock is wrong. Run as a process.

python fault_odd_clock.py SECONDS VERB ...: every look at the time of day in this process is SECONDS ahead (behind, if
negative). Monotonic clocks stay as they are, as they do when somebody sets a clock.
"""

import sys
import time

true_time_ns, true_time = time.time_ns, time.time


def main(shift_s, words):
    # Before anything of labanmesh is imported: its services take the clock as a default argument.
    time.time_ns = lambda: true_time_ns() + round(shift_s * 1e9)
    time.time = lambda: true_time() + shift_s
    import labanmesh

    return labanmesh.main(words)


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), sys.argv[2:]))
