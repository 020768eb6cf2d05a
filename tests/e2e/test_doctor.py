"""What `labanmesh init` writes, as the doctor sees it. Of health: test_up.py; of each fault: tests/deploy."""

from e2e_stage import findings_in, marks
from processes import SOON_S

from labanmesh import main


def test_what_init_writes_lacks_its_model_alone(tmp_path, monkeypatch, capsys):
    # The doctor leaves out what takes long; a busy machine starts the process that reads the models late.
    monkeypatch.setattr("deploy.doctor.scene_file.PREFLIGHT_S", SOON_S)
    monkeypatch.setattr("deploy.doctor.commands.SCENE_S", SOON_S)
    monkeypatch.chdir(tmp_path)
    assert main(["init", "dojo.toml"]) == 0, capsys.readouterr().err
    capsys.readouterr()
    main(["doctor", "dojo.toml", "--for", "0.5", "--json"])
    findings = findings_in(capsys.readouterr().out)
    errors = [what for mark, what, _ in findings if mark == "error" and what.startswith("cam1: ")]
    assert marks(findings, "cam1.model: no such model file -> teach it while it runs: labanmesh teach") == {"warning"}
    assert all("/dev/video" in what for what in errors)
