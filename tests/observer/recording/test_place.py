"""`labanmesh camera place`: where a person stands and faces, from what calibrated cameras see."""

import math

import numpy as np
import pytest
from observer_stage import rejected

from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.placement import PersonPlacement
from observer.geometry.projection import pinhole_matrix, project
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.motion.projected import placed
from observer.recording.commands import place
from observer.recording.person_placement import SHOULDERS_AND_HIPS, seen_person
from observer.recording.reconstruction import CameraTracks
from observer.tracks import BODY_PARTS

STANDING = PersonPlacement(0.6, -0.4, 1.5, 75.0)
PARTS = (*BODY_PARTS, *SHOULDERS_AND_HIPS)
CAMERAS = [pinhole_matrix(math.radians(yaw), 0.15, 3.0, 700, (640, 360), (0.6, 0.9, -0.4)) for yaw in (-50, 0, 45, 120)]


def standing(person=STANDING, frames=30):
    """A person who sways a little while standing, at `person`."""
    rng = np.random.default_rng(0)
    body = [
        [-0.3, 0.8, -0.1],
        [0.3, 0.8, -0.1],
        [0, 1.5, 0],
        [-0.2, 1.3, 0],
        [0.2, 1.3, 0],
        [-0.12, 0.9, 0],
        [0.12, 0.9, 0],
    ]
    positions = (np.array(body) + rng.normal(0, 0.005, (frames, len(body), 3))).astype(np.float32)
    return placed(MotionArchive(PARTS, (Recording(positions, 15.0, "", "anna", "1"),)), person)


def seen_by(positions, rate_hz=15.0, noise_px=2.0):
    """The tracks of all cameras."""
    rng = np.random.default_rng(1)
    at_ns = np.round(np.arange(len(positions)) * 1e9 / rate_hz).astype(np.int64)
    pictures = [project(H, positions) for H in CAMERAS]
    return [
        CameraTracks(f"cam{n}", H, at_ns, pixels + rng.normal(0, noise_px, pixels.shape))
        for n, (H, pixels) in enumerate(zip(CAMERAS, pictures, strict=True))
    ]


def test_the_place_and_the_facing_are_those_of_the_person():
    person = seen_person(seen_by(standing().recordings[0].positions), PARTS, 10.0)
    assert person.placement.place == pytest.approx(STANDING.place, abs=0.02)
    assert person.placement.facing_deg == pytest.approx(75.0, abs=2.0)
    assert not person.doubts and person.head_seen == person.sides_seen == 1.0


def test_a_camera_that_confuses_left_and_right_is_outvoted():
    tracks = seen_by(standing().recordings[0].positions)
    tracks[3].centres[::2] = tracks[3].centres[::2][:, [1, 0, 2, 4, 3, 6, 5]]
    assert seen_person(tracks, PARTS, 10.0).placement.facing_deg == pytest.approx(75.0, abs=3.0)


def test_hands_do_where_no_trunk_is_seen_and_the_answer_says_so():
    person = seen_person(seen_by(standing().recordings[0].positions[:, :3]), BODY_PARTS, 10.0)
    assert person.by_hands and person.placement.facing_deg == pytest.approx(75.0, abs=4.0)
    assert "hands" in person.doubts[0]


def test_a_person_who_turns_is_asked_to_stand_still():
    turning = [
        standing(PersonPlacement(0.6, -0.4, 1.5, angle), 3).recordings[0].positions for angle in range(0, 150, 5)
    ]
    person = seen_person(seen_by(np.concatenate(turning)), PARTS, 10.0)
    assert person.spread_deg > 30 and "stand still" in person.doubts[-1]


def test_a_room_whose_y_does_not_point_up_is_rejected_with_one_line():
    lying = standing().recordings[0].positions[:, :, [0, 2, 1]] * (1, -1, 1)
    with rejected("y does not point up", "--up z"):
        seen_person(seen_by(lying, noise_px=0), PARTS, 10.0, gate_px=1e9)


def test_the_lines_for_the_scene_file_are_printed(command, tmp_path):
    write_archive(tmp_path / "motion.npz", standing())
    lines = ['scene = "dojo"']
    for n, H in enumerate(CAMERAS):
        write_camera(tmp_path / f"cam{n}.toml", CameraModel(f"cam{n}", H, (1280, 720)))
        lines += [f"[observers.cam{n}]", 'source = "motion.npz"', f'view = "cam{n}.toml"']
    (tmp_path / "scene.toml").write_text("\n".join(lines))
    output = command(place)("scene.toml")
    assert "[person]\nplace = [0.60, 1.49, -0.40]\nfacing = 75\n" in output
    assert "trunk in 100%" in output
