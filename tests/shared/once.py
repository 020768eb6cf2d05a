"""What several workers of one run need and one of them makes: a fixture of scope "session" is made in each worker."""

import fcntl
import os
import shutil


def made_once(tmp_path_factory, name, fill):
    """The folder `name` of this run, which `fill(folder)` fills in the worker that comes first. It stays as it is."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    whole, part = root / name, root / f"{name}.part"
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            shutil.rmtree(part, ignore_errors=True)
            part.mkdir()
            fill(part)
            part.rename(whole)
    return whole
