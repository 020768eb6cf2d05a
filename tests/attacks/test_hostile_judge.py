"""A hostile judge among honest ones, more than twenty strategies, before the pure engine: verdicts are as without it.
In the long form the honest judges are observers of a recorded person, at 4 and 30 Hz, some of them blind; a table of
all is written to build/attacks/hostile.md. Where one honest judge that sees is left beside the hostile one, it is one
word against the other: these rows are reported, and required where the lie is about rest."""

import os

import pytest
from attack_history import FOLDER
from attack_person import scripted
from attack_strategies import ABOUT_REST, HONEST, STRATEGIES
from attack_trial import Case, compare, run

ROOMS = [(2, 0), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
"""How many judges, and how many of the honest are blind."""
RATES_HZ = (4, 30)
HOSTILE = tuple(name for name in STRATEGIES if name != HONEST)
SHORT = ("wrong from the first frame", "junk")
SHORT_ROOM = (4, 10, 0)
LONG = os.environ.get("LABANMESH_ATTACKS") == "long"
LONG_ROOMS = [(judges, rate, blind) for judges, blind in ROOMS for rate in RATES_HZ]


def is_required(case):
    """Two honest judges who see are enough against one; a single one is, where the lie is about rest."""
    seeing = case.judges - 1 - case.blind
    return case.judges > 2 and (seeing > 1 or case.strategy in ABOUT_REST)


@pytest.fixture(scope="session")
def harms(person, long_form):
    """What each strategy does in each room, by case; made once."""
    rooms = LONG_ROOMS if long_form else [SHORT_ROOM]
    if long_form and not os.environ.get("LABANMESH_DATA"):
        pytest.skip("LABANMESH_DATA is not set: the recordings of real people are not here")
    person = person if long_form else scripted(movements=1)
    result = {}
    for judges, rate, blind in rooms:
        without = run(person, Case("", judges, rate, blind))
        honest = run(person, Case(HONEST, judges, rate, blind))
        for strategy in HOSTILE if long_form else SHORT:
            case = Case(strategy, judges, rate, blind)
            outcome = run(person, case)
            result[case] = compare(person, without, outcome, honest), outcome
    if long_form:
        FOLDER.mkdir(parents=True, exist_ok=True)
        (FOLDER / "hostile.md").write_text(table(result))
    return result


def table(harms):
    """Strategies by rooms, as Markdown."""
    rooms = list(dict.fromkeys(case.label for case in harms))
    lines = [f"| strategy | {' | '.join(rooms)} |", f"|---|{'---|' * len(rooms)}"]
    for strategy in dict.fromkeys(case.strategy for case in harms):
        cells = {case.label: str(harm) for case, (harm, _) in harms.items() if case.strategy == strategy}
        lines.append(f"| {strategy} | {' | '.join(cells[room] for room in rooms)} |")
    return "\n".join(lines) + "\n"


def cases():
    """The cases that are required."""
    rooms = [(judges, rate, blind) for judges, rate, blind in LONG_ROOMS if judges > 2] if LONG else [SHORT_ROOM]
    for judges, rate, blind in rooms:
        for strategy in HOSTILE if LONG else SHORT:
            case = Case(strategy, judges, rate, blind)
            if is_required(case):
                yield pytest.param(case, id=f"{strategy}-{case.label}")


@pytest.mark.parametrize("case", list(cases()))
def test_with_three_or_four_judges_verdicts_are_as_if_the_hostile_one_were_absent(harms, case):
    harm, outcome = harms[case]
    print(case, harm, outcome.rejected, outcome.reliability)
    assert harm.none, harm
