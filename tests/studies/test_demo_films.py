"""The demo chooses the rate of its films by what the machine can track."""

import pytest

from studies.demo_films import FilmRate


@pytest.mark.parametrize(
    ("tracked_per_s", "rate_hz", "too_slow"),
    [
        (400.0, 15.0, False),
        (60 / 0.7, 15.0, False),
        (60 / 0.71, 10.0, False),
        (50.0, 10.0, True),
        (0.0, 10.0, True),
    ],
)
def test_the_films_have_the_best_rate_that_takes_at_most_70_percent(tracked_per_s, rate_hz, too_slow):
    chosen = FilmRate.within(tracked_per_s, cameras=4)
    assert chosen.rate_hz == rate_hz
    assert (chosen.share > 0.7) == too_slow
    assert ("TOO SLOW: try labanmesh demo --no-pixels" in chosen.text) == too_slow
