"""Runs a verb of labanmesh on a machine whose clock is wrong, or is set while it runs. Run as a process. python
fault_odd_clock.py SECONDS[,SECONDS...] VERB ...: every look at the time of day in this process is SECONDS ahead
(behind, if negative); each SIGUSR1 sets it to the next of them. Monotonic clocks stay as they are, as they do when
somebody sets a clock."""

import signal
import sys
import time

true_time_ns, true_time = time.time_ns, time.time


def main(shifts_s, words):
    shift_s, *later = shifts_s

    def set_clock(*_):
        nonlocal shift_s
        shift_s = later.pop(0)

    signal.signal(signal.SIGUSR1, set_clock)
    # Before anything of labanmesh is imported: its services take the clock as a default argument.
    time.time_ns = lambda: true_time_ns() + round(shift_s * 1e9)
    time.time = lambda: true_time() + shift_s
    import labanmesh

    return labanmesh.main(words)


if __name__ == "__main__":
    sys.exit(main([float(word) for word in sys.argv[1].split(",")], sys.argv[2:]))
