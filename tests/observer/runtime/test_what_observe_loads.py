"""`labanmesh observe` imports no heavy package that it does not use, so that it starts quickly."""

import subprocess
import sys

import pytest
from processes import SOON_S

NEVER = {
    "scipy",
    "matplotlib",
    "rich",
    "cryptography",
    "mediapipe",
    "mcap",
    "starlette",
    "prometheus_client",
    "asyncio",
}
LOOK = """
import sys, labanmesh, observer.commands
assert "numpy" not in sys.modules, "a verb limits its threads before NumPy is loaded"
status = labanmesh.main(["observe", sys.argv[1], "cam1"])
print(status, *sys.modules)
"""


@pytest.mark.parametrize(("tracker", "with_pictures"), [("projected", False), ("camshift", True)])
def test_observe_loads_only_the_packages_it_needs(place, tracker, with_pictures):
    scene = 'scene = "dojo"\n[mesh]\nmode = "process"\nendpoint = "tcp/127.0.0.1:0"\n[observers.cam1]\n'
    scene += f'source = "short.npz"\nspeed = 0\ntracker = "{tracker}"\nsize_px = [160, 120]\n'
    (place / f"{tracker}.toml").write_text(scene)
    words = [sys.executable, "-c", LOOK, str(place / f"{tracker}.toml")]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=SOON_S, check=True)
    status, *modules = ended.stdout.split()
    loaded = {name.partition(".")[0] for name in modules}
    assert status == "0" and {"zenoh", "numpy"} <= loaded
    assert not loaded & NEVER, f"loaded and never used: {sorted(loaded & NEVER)}"
    assert ("cv2" in loaded) == with_pictures
    assert not {"fusion", "hub", "studies", "deploy"} & loaded
    assert "observer.learning.learn" not in modules and "observer.calibration.bundle" not in modules
