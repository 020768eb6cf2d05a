"""The files of the app, by the supervisor's rules (app_files.py). The Python of Home Assistant reads the YAML."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from app_files import AppConfig, Repository, Translations, fits_all
from played_scene import ROOT

FOLDER = ROOT / "deploy" / "home-assistant"
APP = FOLDER / "labanmesh"
READER = "import json, sys, yaml; print(json.dumps([yaml.safe_load(open(path)) for path in sys.argv[1:]]))"


@pytest.fixture(scope="module")
def files():
    """config.yaml, its translations and repository.yaml, as dictionaries."""
    program = os.environ.get("LABANMESH_HASS")
    if not program:
        pytest.skip("LABANMESH_HASS is not set: make test-home brings a Home Assistant")
    paths = [APP / "config.yaml", APP / "translations" / "en.yaml", FOLDER / "repository.yaml"]
    python = Path(program).absolute().with_name("python")
    return json.loads(
        subprocess.run([python, "-c", READER, *paths], capture_output=True, check=True, timeout=60).stdout
    )


def test_the_supervisor_would_take_the_files(files):
    config, translations, repository = files
    AppConfig.model_validate(config)
    Repository.model_validate(repository)
    words = Translations.model_validate(translations)
    assert set(words.configuration) == set(config["schema"]) and set(words.network) == set(config["ports"])
    assert set(config["ports_description"]) == set(config["ports"])


def test_the_supervisor_finds_one_app_and_no_other_file_that_looks_like_one():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    named = [path for path in map(Path, tracked) if path.stem == "config" and path.suffix in (".yaml", ".yml", ".json")]
    assert named == [APP.relative_to(ROOT) / "config.yaml"]


@pytest.mark.parametrize(
    ("options", "allowed"),
    [
        ({}, True),
        ({"cameras": [{"name": "sofa", "source": "rtsp://camera/stream"}, {"name": "shelf"}]}, True),
        ({"router": "tls/attic.local:7447", "certificates": "credentials", "mqtt_port": 8883}, True),
        ({"cameras": [{"name": "Living room"}]}, False),
        ({"router": "attic.local"}, False),
        ({"certificates": "../../etc"}, False),
        ({"scene": "Living room"}, False),
        ({"cameras": [{"source": "0"}]}, False),
    ],
)
def test_options_are_checked_before_the_app_starts(files, options, allowed):
    config = files[0]
    assert fits_all(config["schema"], {**config["options"], **options}) == allowed
