"""The 16 clips through the pose model of a phone's page: `python -m benchmarks.phone_tracks build/phone [build/clips]`.

Chromium runs the page's own code on each picture; the tracks are written as `benchmarks.clips --tracks FOLDER` reads
them, which then prints the verdicts. With a second folder, of tracks by mediapipe in Python, it prints how far apart
the two are. LABANMESH_DATA names the folder of recordings; `labanmesh phone --fetch` brings the model. `--lite`: the
smaller one.
"""

import base64
import gzip
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from playwright.sync_api import Route, sync_playwright

from benchmarks.clips.material import Clip, gesture_clips, pictures_of
from benchmarks.command_line import recordings_folder, run_command
from common import SECOND_NS
from hub.phone.pages import StaticPages
from hub.phone.pose_model_file import data_folder, read_files
from observer.files import read_arrays, write_arrays
from observer.motion.importers.florence3d import FLORENCE_HZ
from observer.tracks import BODY_PARTS, Floats

PAGE = "https://phone.test/"
BLANK = "<!doctype html><title>clips</title>"
SEEN = 0.5
FIND = """async ([pictures, small, periodMs]) => {
  const { loadPose, partsOf } = await import("/tracking.js");
  const pose = await loadPose(small), rows = [];
  for (const [number, picture] of pictures.entries()) {
    const bytes = Uint8Array.from(atob(picture), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const found = pose.detectForVideo(bitmap, 1 + number * periodMs).landmarks[0];
    rows.push(partsOf(found, bitmap.width, bitmap.height));
  }
  pose.close();
  return rows;
}"""


def answer(route: Route, pages: StaticPages) -> None:
    """The files of the phone's page, from this package, and an empty page to run them in."""
    path = route.request.url.removeprefix(PAGE)
    if not path:
        route.fulfill(status=200, body=BLANK, content_type="text/html")
        return
    page = pages.answer(f"/{path}", "")
    headers = dict(page.headers)
    body = gzip.decompress(page.body) if headers.pop("content-encoding", "") else page.body
    route.fulfill(status=page.status, headers=headers, body=body)


def encoded(clip: Clip) -> list[str]:
    """Its pictures as PNG in base64."""
    return [base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode() for picture in pictures_of(clip)]


def track(folder: Path, clips: Sequence[Clip], small: bool) -> None:
    """Write NAME.npz of each clip: times_ns, centres (F, 3, 2) px, parts."""
    pages = StaticPages(read_files(data_folder()), b"", {})
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(600_000)
        page.route("**/*", lambda route: answer(route, pages))
        page.goto(PAGE)
        for clip in clips:
            rows = page.evaluate(FIND, [encoded(clip), small, 1000 / FLORENCE_HZ])
            centres = np.array([[_centre(row[part]) for part in BODY_PARTS] for row in rows])
            times_ns = np.arange(len(rows)) * round(SECOND_NS / FLORENCE_HZ)
            arrays = {"times_ns": times_ns, "centres": centres, "parts": np.array(BODY_PARTS)}
            write_arrays(folder / f"{clip.name}.npz", arrays, compressed=False)
        browser.close()


def _centre(place: list[float] | None) -> list[float]:
    return place[:2] if place is not None and place[2] >= SEEN else [np.nan, np.nan]


def apart(folder: Path, other: Path, clips: Sequence[Clip]) -> Floats:
    """(F, 3) px between the tracks of both folders, all clips one after the other; NaN: not seen by one of them."""
    pairs = [[read_arrays(each / f"{clip.name}.npz")["centres"] for each in (folder, other)] for clip in clips]
    return np.concatenate([np.linalg.norm(first - second, axis=2) for first, second in pairs])


def phone_tracks(
    folder: Annotated[Path, typer.Argument(help="Where the tracks are written.")],
    other: Annotated[Path | None, typer.Argument(help="A folder of tracks to compare them with.")] = None,
    lite: Annotated[bool, typer.Option("--lite", help="The small model.")] = False,
) -> None:
    """Write the tracks of the clips as a phone's page finds them, and compare them with others.

    Example: python -m benchmarks.phone_tracks tracks
    """
    clips = gesture_clips(recordings_folder())
    folder.mkdir(parents=True, exist_ok=True)
    track(folder, clips, lite)
    print(f"{folder}: tracks of {len(clips)} clips; python -m benchmarks.clips --tracks {folder}")
    if other is not None:
        for part, row in zip(BODY_PARTS, apart(folder, other, clips).T, strict=True):
            print(f"{part}: {np.nanmean(row):.1f} px apart on average, median {np.nanmedian(row):.1f}")


if __name__ == "__main__":
    sys.exit(run_command(phone_tracks, "phone_tracks"))
