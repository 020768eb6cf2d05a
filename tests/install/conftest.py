"""Prints verbs by extras when all jobs are done."""

import pytest
from install_stage import ENVIRONMENTS, JOBS

CELLS: dict[tuple[str, str], str] = {}


@pytest.fixture
def cell(request):
    """Notes what became of a job in an environment: `cell(text)`."""

    def note(extras, job, text):
        CELLS[extras, job] = text

    return note


def pytest_terminal_summary(terminalreporter):
    """One row for each job, one column for each environment."""
    columns = [extras for extras in ENVIRONMENTS if any(own == extras for own, _ in CELLS)]
    if not columns:
        return
    rows = [["", *(extras or "plain" for extras in columns)]]
    rows += [[job.name, *(CELLS.get((extras, job.name), "") for extras in columns)] for job in JOBS]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    terminalreporter.write_sep("-", "verbs by extras; a name: the job ends with one line that names that extra")
    for row in rows:
        terminalreporter.write_line("  ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)))
