"""Rendered pictures: the same again, parts where projection has them, nearer before farther, each parameter at work."""

import cv2
import numpy as np
import pytest
from observer_stage import rejected
from rendered_truth import visible_truth

from observer.geometry.projection import parallel_matrix, pinhole_matrix, project
from observer.rendering.body import Stature
from observer.rendering.figure import SKIN_TONES, appearance_of
from observer.rendering.scenery import BACKGROUNDS, Scenery
from observer.rendering.virtual_camera import Renderer

LEFT, RIGHT, HEAD = range(3)
STANDING = Stature(np.array([0.0, 1.6, 0.0]), 1.71)
APART = np.array([[-0.5, 1.2, -0.2], [0.5, 1.5, -0.2], [0.0, 1.6, 0.0]])
SIZE = (640, 480)
UNSEEN = np.full((3, 3), np.nan)


def camera(yaw_deg=0.0, pitch_deg=0.0, size=SIZE):
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return pinhole_matrix(np.radians(yaw_deg), np.radians(pitch_deg), 3.5, 1.35 * size[1], centre, (0.0, 0.96, 0.0))


def renderer(yaw_deg=0.0, pitch_deg=0.0, seed=0, appearance=None, **scenery):
    return Renderer(camera(yaw_deg, pitch_deg), SIZE, Scenery(**scenery), seed, appearance, STANDING)


def skin(picture):
    blue, green, red = picture.astype(int).transpose(2, 0, 1)
    return (red - blue > 25) & (red - green > 8)


def blobs(picture):
    """Centres and areas of skin-coloured blobs."""
    _, _, stats, centres = cv2.connectedComponentsWithStats(skin(picture).astype(np.uint8))
    keep = stats[1:, cv2.CC_STAT_AREA] > 30
    return centres[1:][keep], stats[1:, cv2.CC_STAT_AREA][keep]


def with_(part, place, positions=APART):
    changed = positions.copy()
    changed[part] = place
    return changed


FULL = {"noise": 5.0}


@pytest.mark.parametrize("background", BACKGROUNDS)
def test_pictures_depend_on_the_arguments_and_the_seed_only(background):
    first, second = (renderer(seed=3, background=background, **FULL) for _ in range(2))
    expected = first.picture(APART, 70)
    second.picture(APART + 0.1, 3)
    assert expected.shape == (480, 640, 3) and expected.dtype == np.uint8
    np.testing.assert_array_equal(expected, second.picture(APART, 70))
    empty, other = (renderer(seed=seed, background=background).picture(UNSEEN, 0) for seed in (3, 4))
    assert (empty != other).any()
    assert appearance_of(3) != appearance_of(4)


@pytest.mark.parametrize("yaw_deg", [0, 45, -45, 20])
def test_hands_are_drawn_at_their_projections(yaw_deg):
    for seed in range(3):
        view = renderer(yaw_deg, seed=seed)
        centres, _ = blobs(view.picture(APART, 0))
        wanted = project(camera(yaw_deg), APART)
        truth = visible_truth(view, APART)
        np.testing.assert_allclose(truth.centres, wanted, atol=1e-9)
        for hand in (LEFT, RIGHT):
            if truth.shares[hand] > 0.85:
                assert np.linalg.norm(centres - wanted[hand], axis=1).min() < 3.0
    assert truth.shares[RIGHT] > 0.85


@pytest.mark.parametrize("seed", range(4))
def test_only_skin_has_the_colour_of_skin(seed):
    appearance = appearance_of(seed)
    assert (np.min(SKIN_TONES, axis=0) <= appearance.skin).all() and (
        appearance.skin <= np.max(SKIN_TONES, axis=0)
    ).all()
    assert appearance.skin[0] < appearance.skin[1] < appearance.skin[2]
    for background in ("plain", "cluttered"):
        assert not skin(renderer(seed=seed, background=background).picture(UNSEEN, 0)).any()
    assert skin(renderer(seed=seed, background="skin_toned").picture(UNSEEN, 0)).mean() > 0.5
    turned = renderer(180.0, seed=seed, appearance=appearance).picture(with_([LEFT, RIGHT], np.nan), 0)
    assert skin(turned).sum() < 200  # from behind, a head of 960 px is mostly hair


@pytest.mark.parametrize(
    ("hand", "position", "yaw_deg", "hand_share", "head_share"),
    [
        (RIGHT, [0.0, 1.6, -0.25], 0.0, (0.9, 1.0), (0.0, 0.75)),  # in front of the face
        (RIGHT, [0.0, 1.6, 0.25], 0.0, (0.0, 0.3), (0.95, 1.0)),  # behind the head
        (RIGHT, [0.0, 1.15, 0.25], 0.0, (0.0, 0.0), (0.9, 1.0)),  # behind the trunk
        (RIGHT, [0.0, 1.15, 0.25], 180.0, (0.9, 1.0), (0.9, 1.0)),
        (LEFT, [-0.3, 1.1, 0.0], 90.0, (0.0, 0.1), (0.9, 1.0)),  # the far hand from the side
        (LEFT, [-0.3, 1.1, 0.0], -90.0, (0.9, 1.0), (0.9, 1.0)),
        (RIGHT, [1.73, 1.5, 0.0], 0.0, (0.2, 0.8), (0.9, 1.0)),  # half outside the picture
        (RIGHT, [2.5, 1.5, 0.0], 0.0, (0.0, 0.0), (0.9, 1.0)),
        (RIGHT, [0.3, 1.0, -5.0], 0.0, (0.0, 0.0), (0.9, 1.0)),  # behind the camera
    ],
)
def test_occlusion(hand, position, yaw_deg, hand_share, head_share):
    positions = with_(hand, position)
    truth = visible_truth(renderer(yaw_deg), positions)
    for part, (least, most) in ((hand, hand_share), (HEAD, head_share)):
        assert least <= truth.shares[part] <= most
        assert np.isnan(truth.centres[part]).all() == (truth.shares[part] == 0)
    if truth.shares[hand] == 0:
        assert not truth.visible()[hand] and len(blobs(renderer(yaw_deg).picture(positions, 0))[0]) == 2


@pytest.mark.parametrize("part", [LEFT, RIGHT, HEAD])
def test_an_unseen_part_is_not_drawn(part):
    view = renderer(appearance=appearance_of(5))
    positions = with_(part, np.nan)
    truth = visible_truth(view, positions)
    assert truth.shares[part] == 0 and np.isnan(truth.centres[part]).all()
    assert truth.visible().sum() == 2
    centres, _ = blobs(view.picture(positions, 0))
    assert np.linalg.norm(centres - project(camera(), APART)[part], axis=1).min() > 30


def test_noise_has_its_deviation_and_differs_between_frames():
    clean = renderer().picture(APART, 0).astype(int)
    noisy = [renderer(noise=6.0).picture(APART, frame).astype(int) for frame in (0, 1)]
    assert (noisy[0] - clean).std() == pytest.approx(6.0, rel=0.05)
    assert abs((noisy[0] - clean).mean()) < 0.1
    across = np.corrcoef((noisy[0] - clean)[:200].ravel(), (noisy[1] - clean)[:200].ravel())[0, 1]
    assert abs(across) < 0.1


def test_invalid_arguments_are_rejected_with_one_line():
    wrong = [
        lambda: Scenery(background="forest"),
        lambda: Scenery(noise=-1.0),
        lambda: Scenery(noise=float("nan")),
        lambda: Renderer(parallel_matrix(0.0, 0.0)),
        lambda: Renderer(np.eye(3)),
        lambda: Renderer(np.zeros((3, 4))),
        lambda: Renderer(camera(), (4, 4)),
        lambda: Renderer(camera(), seed=-1),
        lambda: renderer().picture(np.zeros((2, 3)), 0),
    ]
    for make in wrong:
        with rejected():
            make()
