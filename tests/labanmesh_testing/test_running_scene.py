"""The pytest plugin: what it says when no verdict comes, and what it refuses. Others run its examples."""

import pytest

from common.errors import BadInput


@pytest.fixture
def scene(laban_scene):
    return laban_scene(["wave", "clap"], ["sofa", "shelf"], fusion={"quorum": 2})


def test_a_wait_that_fails_lists_what_arrived(scene):
    for name, label in (("sofa", "wave"), ("shelf", "clap")):
        scene.observers[name].votes([(label, 60)])
    scene.listener.wait_for_judgement(lambda j: [v.label for v in j.votes.values()] == ["wave", "clap"])
    listed = r"verdicts: none; the last .* by sofa wave \(counted\), shelf clap \(counted\)$"
    with pytest.raises(AssertionError, match=f"^no verdict wave within 0 s; {listed}"):
        scene.listener.wait_for_verdict("wave", timeout=0)
    with pytest.raises(AssertionError, match="no such judgement within 0 s"):
        scene.listener.wait_for_judgement(lambda judgement: judgement.label == "bow", timeout=0)


def test_a_script_that_no_observer_could_follow_is_one_line(scene):
    with pytest.raises(BadInput, match=r"^sofa: 'wafe': not a label of this scene; did you mean wave"):
        scene.observers["sofa"].votes([("wafe", 1)])
    with pytest.raises(BadInput, match=r"^sofa: probability 0.5: between chance"):
        scene.observers["sofa"].votes([("wave", 1, 0.5)])


def test_an_exception_of_a_callback_is_an_error_of_the_test(scene):
    def fail(verdict):
        raise ValueError("no lamp")

    scene.listener.on_verdict(fail)
    for observer in scene.observers.values():
        observer.votes([("wave", 60)])
    with pytest.raises(ValueError, match="no lamp"):
        scene.listener.wait_for_verdict("wave")


def test_a_package_that_hides_ours_is_one_line(request, monkeypatch):
    monkeypatch.setattr(
        "labanmesh.shadowed", lambda: "/home/me/common hides the package 'common' of labanmesh; rename it"
    )
    with pytest.raises(pytest.fail.Exception, match=r"^laban_scene: /home/me/common hides the package"):
        request.getfixturevalue("laban_scene")
