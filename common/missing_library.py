"""What to do about a library that cannot be imported. Imported only when that has happened."""

from importlib.metadata import PackageNotFoundError, version

EXTRAS = {
    "cv2": "observer",
    "scipy": "observer",
    "matplotlib": "report",
    "mcap": "capture",
    "aiomqtt": "mqtt",
    **dict.fromkeys(("websockets", "segno"), "phone"),
    **dict.fromkeys(("starlette", "uvicorn", "sse_starlette"), "dashboard"),
}
"""Libraries that a plain install lacks, and the extra that installs them."""
NOT_FOUND_BY_LOADER = "cannot open shared object file"
"""The loader's error for a library of the system that is not installed."""
INSTALL_LIBRARY = "install that library of the system (libGL on Debian and Ubuntu: apt-get install libgl1 libglib2.0-0)"


def missing_library(error: ImportError) -> str:
    """What is missing and how to install it, one line; "" for an error that is a fault of the program."""
    package = (error.name or "").partition(".")[0]
    if isinstance(error, ModuleNotFoundError):
        way_out = f"pip install 'labanmesh[{EXTRAS[package]}]'" if package in EXTRAS else ""
        return way_out and f"{package} is not installed on this machine; {way_out}"
    # The OpenCV that mediapipe brings draws windows, and wants the system's libGL.
    if NOT_FOUND_BY_LOADER in str(error):
        return f"{' '.join(str(error).split())}; {INSTALL_LIBRARY}{_opencv_without_windows()}"
    return ""


def _opencv_without_windows() -> str:
    """How to do without libGL, where an OpenCV with windows lies on top of the one without."""
    try:
        installed = version("opencv-contrib-python")
    except PackageNotFoundError:
        return ""
    return (
        ", or put the OpenCV without windows on top: "
        f"pip install --force-reinstall --no-deps opencv-python-headless=={installed}"
    )
