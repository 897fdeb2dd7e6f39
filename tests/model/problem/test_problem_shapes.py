"""What has to fit together: the gains' shapes, and a network that can agree at all."""

import pytest
from problem_cases import GAINS, GIVEN, changed

from lockstep.model import ProblemError, parse_problem


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("B = [[1.0], [2.0]]", "B = [[1.0], [2.0], [3.0]]", "`B` is 3 x 1; expected `A` is 2 x 2"),
        ("B = [[1.0], [2.0]]", "B = [[1.0, 2.0]]", "`B` is 1 x 2"),
        ("B = [[1.0], [2.0]]", "B = [[1.0], [2.0, 3.0]]", "rows of 1 and of 2"),
        ("B = [[1.0], [2.0]]", "", "`B` is missing or empty"),
        ("A = [[-1.0, 0.5], [0.0, -2.0]]", "A = [[-1.0, 0.5]]", "`A` is 1 x 2"),
        (
            "A = [[-1.0, 0.5], [0.0, -2.0]]",
            "A = [[nan, 0.5], [0.0, -2.0]]",
            "2, A, row 1, column 1: found nan",
        ),
        (
            "A = [[-1.0, 0.5], [0.0, -2.0]]",
            "A = [[true, 0.5], [0.0, -2.0]]",
            "2, A, row 1, column 1: found true",
        ),
        ("A = [[-1.0, 0.5], [0.0, -2.0]]", "A = 3", "2, A: `A` is 3"),
        ("C = [[3.0, 4.0]]", "C = [[3.0], [4.0]]", "`C` is 2 x 1"),
        ("D = [[5.0]]", "D = [[5.0, 6.0]]", "`D` is 1 x 2"),
        ("D = [[5.0]]", "", "[[design.gains]] 2: the key `D` is missing"),
        ("D = [[5.0]]", "D = [[5.0]]\nE = 1", "[[design.gains]] 2: unknown key `E`"),
    ],
)
def test_bad_gains_are_refused(old: str, new: str, says: str) -> None:
    assert parse_problem(GIVEN + 3 * GAINS).order == 2
    with pytest.raises(ProblemError) as caught:
        parse_problem(GIVEN + GAINS + changed(old, new, GAINS) + GAINS)
    assert says in str(caught.value)
    assert "[[design.gains]] 2" in str(caught.value)


def test_gains_of_different_orders_and_numbers_are_refused() -> None:
    first_order = "[[design.gains]]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[3.0]]\nD = [[5.0]]\n"
    with pytest.raises(ProblemError, match="controllers of one order"):
        parse_problem(GIVEN + 2 * GAINS + first_order)
    with pytest.raises(ProblemError, match="2 tables of gains for 3 agents"):
        parse_problem(GIVEN + 2 * GAINS)
    with pytest.raises(ProblemError, match="`order` is 1, but the gains"):
        parse_problem(GIVEN.replace("[design]", "[design]\norder = 1") + 3 * GAINS)
    assert parse_problem(GIVEN.replace("[design]", "[design]\norder = 2") + 3 * GAINS).order == 2


@pytest.mark.parametrize("rest", ["", "A = []\nB = []\nC = []\n", "C = [[]]\n"])
def test_static_gains_need_D_only(rest: str) -> None:
    problem = parse_problem(GIVEN + 3 * f"[[design.gains]]\n{rest}D = [[5.0]]\n")
    assert problem.order == 0
    assert problem.gains is not None
    assert [M.shape for M in vars(problem.gains[0]).values()] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert problem.controller_weight(0).shape == (0, 0)
    with pytest.raises(ProblemError, match="`B` is 1 x 1"):
        parse_problem(GIVEN + 3 * f"[[design.gains]]\n{rest.replace('B = []', '')}B = [[1.0]]\nD = [[5.0]]\n")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[3, 1]", "[1, 3]", None),
        ("[2, 3], [3, 1]", "[2, 1]", "agents 1, 2 and agent 3 hear nothing from each other"),
        ("[1, 2], [2, 3], [3, 1]", "", "no spanning tree"),
        (
            "+ b*f",
            "",
            "(A, B) is not stabilisable: no input moves the mode at the eigenvalue 0 +- 1.41421i of A, which does not",
        ),
        (
            'p = "v"',
            'p = "-p"',
            "(A, C) is not detectable: no output shows the mode at the eigenvalue 0 of A, which does not decay",
        ),
        (
            'v = "-k*p - sin(p) + b*f"',
            'v = "-v + b*p"',
            "(A, B) is not stabilisable: no input moves the mode at the eigenvalue 1.30278 of A",
        ),
        (
            'p = "v"\n',
            'p = "-p + f"\n',
            "(A, C) is not detectable: no output shows the mode at the eigenvalue 0 of A, which does not decay",
        ),
        ('"-k*p - sin(p) + b*f"', '"-v + f"', None),
    ],
)
def test_a_network_that_cannot_agree_is_refused(old: str, new: str, says: str | None) -> None:
    problem = parse_problem(changed(old, new))
    if says is None:
        problem.validate()
        return
    with pytest.raises(ProblemError) as caught:
        problem.validate()
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("rate", "says"),
    [
        ("-3", None),
        ("-1e-9", None),
        # Beside the eigenvalue -1 rounding cannot tell this one from 0.
        ("-1e-17", "no output shows the mode at the eigenvalue 0 of A"),
        ("0", "no output shows the mode at the eigenvalue 0 of A, which does not decay by itself"),
        ("1e-9", "no output shows the mode at the eigenvalue 1e-09 of A, which does not decay by itself"),
        ("3", "no output shows the mode at the eigenvalue 3 of A, which does not decay by itself"),
    ],
)
def test_a_lost_mode_that_decays_is_enough(rate: str, says: str | None) -> None:
    problem = parse_problem(changed('p = "v"', 'p = "f - p"').replace("-k*p - sin(p) + b*f", f"{rate}*v"))
    if says is None:
        problem.validate()
        return
    with pytest.raises(ProblemError) as caught:
        problem.validate()
    assert says in str(caught.value)
