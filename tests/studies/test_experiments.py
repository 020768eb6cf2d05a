"""The paper's three experiments run and are printed beside the paper's tables (here on the synthetic performer)."""

from observer.motion.archive_file import write_archive
from studies.commands import paper
from studies.performer import perform


def test_all_three_are_printed_beside_the_papers(tmp_path, capsys):
    archive = tmp_path / "synthetic.npz"
    write_archive(archive, perform(trials=2, seed=1))
    paper(archive, report=tmp_path / "out")
    text = capsys.readouterr().out
    for title in ("Table I:", "Table II:", "Table III:", "32(of 95)", "all, confusions of one view"):
        assert title in text
    assert "1: one camera on the Door plane" in text.splitlines()[-6]
    assert (tmp_path / "out" / "experiments.txt").read_text() in text
    assert (tmp_path / "out" / "all" / "confusion-fused.png").exists()
