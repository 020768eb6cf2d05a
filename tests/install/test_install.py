"""The wheel with each extra alone, and with those of `make install`: every verb works, or names the extra it lacks. Not
part of `make test`: it fetches packages. `make test-install`; `-k with_plain` for one environment."""

import re
import shutil

import pytest
from doc_pages import DOCS, blocks
from install_stage import ENVIRONMENTS, JOBS, Environment, build_wheel, extras_of, write_material

from labanmesh import VERBS

pytestmark = pytest.mark.timeout(1800)
"""Seconds: pip installs an environment within the first test that uses it."""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    return build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session")
def material(tmp_path_factory):
    folder = tmp_path_factory.mktemp("material")
    write_material(folder)
    return folder


@pytest.fixture(scope="session", params=ENVIRONMENTS, ids=lambda extras: f"with_{extras or 'plain'}")
def environment(request, tmp_path_factory, wheel):
    environment = Environment(tmp_path_factory.getbasetemp(), wheel, request.param)
    environment.name = request.param
    yield environment
    environment.remove()


def test_every_verb_has_a_job():
    assert {job.words.split()[0] for job in JOBS} == VERBS.keys()


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.name)
def test_a_verb_works_or_names_its_extra(environment, job, material, tmp_path, cell):
    shutil.copytree(material, tmp_path, dirs_exist_ok=True)
    has_all = extras_of(job.needs) <= environment.extras
    cell(environment.name, job.name, "FAILS")
    status, out, err = environment.run(["labanmesh", *job.words.split()], tmp_path, job.line if job.ended else "")
    assert "Traceback" not in out + err and "ModuleNotFoundError" not in out + err, out + err
    works = status == job.status and job.line in out + err
    # mediapipe, for one, brings matplotlib, so that more may work than the extra promises.
    assert works or not has_all, (status, out, err)
    if not works:
        # Progress may precede the error.
        (error,) = (line for line in err.splitlines() if line.startswith("labanmesh: "))
        assert status in (1, 2) and err.endswith(f"{error}\n"), (status, out, err)
        named = "|".join(extras_of(job.needs) - environment.extras)
        assert re.search(rf"pip install 'labanmesh\[({named})\]'", error), err
    cell(environment.name, job.name, "works" if works else job.needs)


def test_a_project_elsewhere_tests_with_the_plugin(environment, tmp_path):
    if "testing" not in environment.extras:
        pytest.skip("only with the extra testing")
    (tmp_path / "test_lamp.py").write_text(blocks(DOCS / "guide" / "testing.md", "python")[0])
    status, out, err = environment.run(["pytest", "-q", "-p", "no:cacheprovider", "--durations=3"], tmp_path)
    assert status == 0, out + err
    print(out)
