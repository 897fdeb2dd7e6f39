"""Problem files that are refused: one change per bad file, and what the message says of it."""

from pathlib import Path

import pytest
from problem_cases import SMALL, changed

from lockstep.model import ProblemError, load_problem, parse_problem


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[agent]\n", "[agent]\nstats = 1\n", ["[agent]", "unknown key `stats`", "did you mean `states`?"]),
        ('states = ["p", "v"]', 'stats = ["p", "v"]', ["`stats`", "did you mean `states`?", "missing"]),
        ('title = "small"', 'titel = "small"', ["unknown key `titel`", "did you mean `title`?"]),
        ('title = "small"', "title = 3", ["`title` is 3", "expected text"]),
        ('title = "small"', "period = 1", ["unknown key `period`", "belongs in [controller]"]),
        ('title = "small"', "", []),
        ("[design]\n", "[design]\ngainlimit = 3\n", ["[design]", "did you mean `gain_limit`?"]),
        ("[design]\n", "[design]\nstart = 3\n", ["[design]", "did you mean `starts`?", "`start` belongs in"]),
        ("[design]\n", "[design]\nperiod = 3\n", ["[design]", "belongs in [controller]"]),
        ("[design]\n", "[desing]\n", ["unknown key `desing`", "did you mean `design`?"]),
        ("[design]\n", "[design]\nweights = { stat = 1 }\n", ["[design.weights]", "did you mean `state`?"]),
        (
            "[design]\n",
            "[design]\ndisturbances = { states = 0, outputs = { y1 = 0 } }\n",
            ["[design.disturbances]", "every scale is 0", "rho is a gain from it"],
        ),
        (
            "[design]\n",
            "[design]\nfragility = { E = 1 }\n",
            ["[design.fragility]", "unknown key `E`", "A, B, C, D"],
        ),
        (
            "[design]\norder = 1\n",
            "[design]\norder = 0\nfragility = { A = 0.5, B = 0.2, D = 0.1 }\n",
            ["[design] fragility", "A = 0.5, B = 0.2;", "leave A, B and C out"],
        ),
        ('states = ["p", "v"]\n', "", ["[agent]", "the key `states` is missing"]),
        ('inputs = ["f"]\n', "", ["[agent]", "`inputs` is missing"]),
        ('[agent.outputs]\ny1 = "c*p"\n', "", ["[agent]", "`outputs` is missing"]),
        ('v = "-k*p - sin(p) + b*f"\n', "", ["[agent.dynamics]", "no equation for the state `v`"]),
        ('v = "-k*p', 'w = "0"\nv = "-k*p', ["[agent.dynamics]", "`w` is unknown"]),
        ("sin(p)", "sine(p)", ["[agent.dynamics] v", "`sine`", "did you mean `sin`?"]),
        ("sin(p)", "q", ["[agent.dynamics] v", "unknown symbol `q`"]),
        ("sin(p)", "__import__('os')", ["[agent.dynamics] v", "`__import__` is not part"]),
        ("b*f", "b*f**2", ["[agent.dynamics] v", "`f`", "linearly"]),
        ('v = "-k*p - sin(p) + b*f"', "v = 0", ["[agent.dynamics] v", "`v` is 0", "formula as text"]),
        ('y1 = "c*p"', 'y1 = "c*p + 1"', ["[agent.outputs] y1", "constant 1"]),
        ('y1 = "c*p"', "y1 = 1", ["[agent.outputs] y1", "`y1` is 1", "formula as text"]),
        ('name = "cart"', 'name = "my cart"', ["[agent] name", "C identifier"]),
        ('name = "cart"', "name = 3", ["[agent] name", "`name` is 3"]),
        ('states = ["p", "v"]', 'states = "p"', ["[agent] states", '`states` is "p"', "list of names"]),
        ('states = ["p", "v"]', 'states = ["p", 3]', ["[agent] states, entry 2", "found 3"]),
        ("k = 2.0,", 'k = "2.0",', ["[agent.parameters] k", '`k` is "2.0"', "finite number"]),
        ("k = 2.0,", "k = true,", ["[agent.parameters] k", "`k` is true"]),
        ("k = 2.0,", "k = nan,", ["[agent.parameters] k", "`k` is nan"]),
        ("k = 2.0,", "k = inf,", ["[agent.parameters] k", "`k` is inf"]),
        ("k = 2.0,", "k = 1979-05-27,", ["[agent.parameters] k", "1979-05-27"]),
        ("k = 2.0,", "k = [1],", ["[agent.parameters] k", "a list"]),
        ("k = 2.0,", f"k = {'9' * 400},", ["[agent.parameters] k", "too large for a double"]),
        (
            "[agent.outputs]",
            "[agent.domain]\np = [1, 0]\n[agent.outputs]",
            ["[agent.domain] p", "from 1.0 to 0.0"],
        ),
        ("[agent.outputs]", "[agent.domain]\np = [nan, 0]\n[agent.outputs]", ["[agent.domain] p", "nan"]),
        ("[agent.outputs]", "[agent.domain]\np = [inf, inf]\n[agent.outputs]", ["[agent.domain] p", "inf"]),
        ("[agent.outputs]", "[agent.domain]\np = [0]\n[agent.outputs]", ["[agent.domain] p", "two numbers"]),
        ("[agent.outputs]", "[agent.domain]\np = 3\n[agent.outputs]", ["[agent.domain] p", "two numbers"]),
        ("[agent.outputs]", '[agent.domain]\np = ["0", 1]\n[agent.outputs]', ["[agent.domain] p", '"0"']),
        (
            "[agent.outputs]",
            "[agent.domain]\nq = [0, 1]\n[agent.outputs]",
            ["[agent.domain]", "`q` is unknown"],
        ),
        ("[agent.outputs]", '[agent.units]\nq = "m"\n[agent.outputs]', ["[agent.units]", "`q` is unknown"]),
        ("agents = 3\n", "", ["[network]", "`agents` is missing"]),
        ("agents = 3", "agents = 3.0", ["[network] agents", "`agents` is 3.0", "whole number"]),
        ("agents = 3", "agents = true", ["[network] agents", "`agents` is true"]),
        ("agents = 3", "agents = 1", ["[network] agents", "`agents` is 1"]),
        ("agents = 3", "agents = 2", ["[network] edges", "edge 2", "out of range"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "", ["[network]", "no graph", "exactly one"]),
        ("edges", 'topology = "cycle"\nedges', ["[network]", "`edges` and `topology` are given"]),
        (
            "edges = [[1, 2], [2, 3], [3, 1]]",
            'topology = "torus"',
            ["[network] topology", '"torus"', '"cycle"'],
        ),
        (
            "edges = [[1, 2], [2, 3], [3, 1]]",
            "laplacian = [[1, -1], [-1, 1]]",
            ["[network] agents", "2 rows"],
        ),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = [[1, -1, 0], [-1, 1]]", ["laplacian", "square"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = []", ["laplacian", "square"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "edges = [1, 2]", ["[network] edges", "found 1"]),
        ("[1, 2]", '["1", 2]', ["[network] edges, row 1, column 1", '"1"']),
        ("[1, 2]", "[1, 1]", ["edge 1", "self loop"]),
        ("[1, 2]", "[1, 2, nan]", ["edges, row 1, column 3", "nan"]),
        ("[1, 2]", "[2, 3]", ["there twice"]),
        ("order = 1", "order = -1", ["[design] order", "`order` is -1", "0 (static"]),
        ("order = 1", "order = 1.0", ["[design] order", "`order` is 1.0", "whole number"]),
        ("order = 1", "order = true", ["[design] order", "`order` is true"]),
        ("order = 1", 'order = "1"', ["[design] order", '`order` is "1"']),
        ("order = 1", "order = 65", ["[design] order", "65"]),
        ("order = 1", 'method = "magic"', ["[design] method", '"magic"', '"certified"']),
        ("order = 1", 'method = "given"', ["[design]", "no gains"]),
        ("order = 1", "gain_limit = 0", ["[design] gain_limit", "`gain_limit` is 0", "above 0"]),
        ("order = 1", "gain_limit = inf", ["[design] gain_limit", "inf"]),
        (
            "order = 1",
            "gain_units = { time = 0 }",
            ["[design.gain_units] time", "`time` is 0", "seconds above 0"],
        ),
        (
            "order = 1",
            "gain_units = { inputs = { nu = 2 } }",
            ["[design.gain_units] inputs", "`nu` is no input"],
        ),
        ("order = 1", "gain_units = { outputs = -1 }", ["[design.gain_units] outputs", "-1", "above 0"]),
        (
            "order = 1",
            "gain_units = { time = 1e300, outputs = 1e300 }",
            ["[design.gain_units]", "units nearer to 1"],
        ),
        ("order = 1", "gain_units = { inputs = 1e308 }", ["[design.gain_units]", "no finite number above 0"]),
        ("order = 1", "alpha = -1", ["[design] alpha", "-1"]),
        ("order = 1", "decay = [1,5]", ["[design] decay", "0.5, not 0,5"]),
        ("[network]", "[agent.limits]\nf = [-4,0, 4,0]\n[network]", ["[agent.limits] f", "0.5, not 0,5"]),
        ("order = 1", "alpha = nan", ["[design] alpha", "nan"]),
        ("order = 1", 'objective = "alpha"', ["[design]", "`rho` is missing"]),
        ("order = 1", "rho = 3", ["[design] rho", "minimised"]),
        ("order = 1", 'coordinates = "mine"', ["[design] coordinates", '"orthonormal"']),
        ("order = 1", "starts = 0", ["[design] starts", "`starts` is 0"]),
        ("order = 1", "seed = -1", ["[design] seed", "`seed` is -1"]),
        ("order = 1", "fragility = { A = -0.1 }", ["[design.fragility] A", "`A` is -0.1"]),
        ("order = 1", "fragility = 0.1", ["[design] fragility", "a table"]),
        ("order = 1", "weights = 3", ["[design] weights", "a table"]),
        ("order = 1", 'weights = { state = "1" }', ["[design.weights] state", '"1"', "symmetric"]),
        ("order = 1", "weights = { state = true }", ["[design.weights] state", "true"]),
        ("order = 1", "weights = { state = nan }", ["[design.weights] state", "finite"]),
        ("order = 1", "weights = { state = [1, nan] }", ["[design.weights] state", "finite"]),
        ("order = 1", "weights = { state = 0 }", ["[design.weights] state", "smallest eigenvalue is 0"]),
        (
            "order = 1",
            "weights = { state = [1, 2, 3] }",
            ["[design.weights] state", "3 numbers for 2 states"],
        ),
        ("order = 1", "weights = { state = [[1, 0], [0, 1], [0, 0]] }", ["[design.weights] state", "3 x 2"]),
        ("order = 1", "weights = { state = [[1, 0], [0]] }", ["[design.weights] state", "different lengths"]),
        ("order = 1", "weights = { state = [[1, 0], 1] }", ["[design.weights] state", "a list"]),
        ("order = 1", "weights = { state = [] }", ["[design.weights] state", "a list"]),
        (
            "order = 1",
            "weights = { state = [[1, 0.1], [0.2, 1]] }",
            ["[design.weights] state", "0.1", "0.2", "symmetric"],
        ),
        (
            "order = 1",
            "weights = { state = [[1, 2], [2, 1]] }",
            ["[design.weights] state", "smallest eigenvalue is -1"],
        ),
        (
            "order = 1",
            "weights = { controller = [1] }",
            ["[design.weights] controller", "1 numbers for 2 controller states"],
        ),
        ("order = 1", "[[design.gains]]\nD = [[1.0]]", ["[[design.gains]]", '`method` is "certified"']),
        ("period = 0.01", "period = 0", ["[controller] period", "`period` is 0", "above 0"]),
        ("period = 0.01", "period = -0.0", ["[controller] period", "`period` is -0.0"]),
        ("period = 0.01", "period = nan", ["[controller] period", "nan"]),
        ("period = 0.01", "period = inf", ["[controller] period", "inf"]),
        ("period = 0.01", 'period = "5 ms"', ["[controller] period", '"5 ms"', "seconds"]),
        ("period = 0.01", 'discretization = "rk4"', ["[controller] discretization", '"tustin"']),
        ("period = 0.01", 'real = "float16"', ["[controller] real", '"float16"', '"float32"']),
        ("period = 0.01", "delay = 2", ["[controller] delay", "`delay` is 2"]),
        ("horizon = 5", "horizon = 0", ["[simulation] horizon", "`horizon` is 0"]),
        ("horizon = 5", 'initial = "zero"', ["[simulation] initial", '"zero"', "random"]),
        ("horizon = 5", "initial = [[1, 2], [1, 2]]", ["[simulation] initial", "2 rows for 3 agents"]),
        ("horizon = 5", "initial = [[1, 2], [1], [2, 3]]", ["[simulation] initial", "row 2 has 1 numbers"]),
        ("horizon = 5", "initial = [[1,5, 2], [1, 0], [2, 3]]", ["row 1 has 3 numbers", "0.5, not 0,5"]),
        ("horizon = 5", "initial = [[1, nan], [1, 0], [2, 3]]", ["[simulation] initial", "nan"]),
        ("horizon = 5", 'disturbance = { kind = "chaos" }', ["[simulation.disturbance] kind", '"noise"']),
        ("[network]", "[network", ["not TOML", "line 13, column"]),
        ("agents = 3", "agents = 3\nagents = 4", ["not TOML", "line 15"]),
        ("agents = 3", "agents = ", ["not TOML", "line 14"]),
    ],
)
def test_bad_files_are_refused(old: str, new: str, says: list) -> None:
    text = changed(old, new)
    if not says:
        parse_problem(text)
        return
    with pytest.raises(ProblemError) as caught:
        parse_problem(text, "small.toml")
    message = str(caught.value)
    assert message.startswith("small.toml")
    assert "\n" not in message
    assert "pydantic" not in message.lower()
    for part in says:
        assert part in message, message


def test_several_errors_are_one_message() -> None:
    text = (
        changed("order = 1", "order = -1")
        .replace("period = 0.01", "period = 0")
        .replace("k = 2.0", "k = nan")
    )
    with pytest.raises(ProblemError) as caught:
        parse_problem(text)
    message = str(caught.value)
    assert message.count("also ") == 2
    for part in ("[agent.parameters] k", "[design] order", "[controller] period"):
        assert part in message


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="there is no such file"):
        load_problem(tmp_path / "none.toml")
    with pytest.raises(ProblemError, match="a directory"):
        load_problem(tmp_path)
    with pytest.raises(ProblemError, match="no regular file"):
        load_problem("/dev/zero")
    with pytest.raises(ProblemError, match="there is no such file"):
        load_problem("a\0b")
    (tmp_path / "latin.toml").write_bytes('title = "caf\xe9"'.encode("latin-1"))
    with pytest.raises(ProblemError, match=r"latin.toml: byte 13 is not UTF-8"):
        load_problem(tmp_path / "latin.toml")
    (tmp_path / "nul.toml").write_bytes(SMALL.encode() + b"\0")
    with pytest.raises(ProblemError, match="not TOML"):
        load_problem(tmp_path / "nul.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * 10_000_001)
    with pytest.raises(ProblemError, match="10000001 bytes"):
        load_problem(tmp_path / "large.toml")
    (tmp_path / "empty.toml").write_bytes(b"")
    with pytest.raises(ProblemError, match="`agent` is missing"):
        load_problem(tmp_path / "empty.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(ProblemError, match="not TOML"):
        load_problem(tmp_path / "deep.toml")
    (tmp_path / "digits.toml").write_text("a = " + "9" * 100_000, encoding="utf-8")
    with pytest.raises(
        ProblemError, match=r"line 1: `9+ \.\.\. 9+` has too many digits; expected at most 10000"
    ):
        load_problem(tmp_path / "digits.toml")
    (tmp_path / "bom.toml").write_text(SMALL, encoding="utf-8-sig")
    load_problem(tmp_path / "bom.toml")


TABLES = [
    "",
    "[agent]",
    "[network]",
    "[design]",
    "[design.weights]",
    "[controller]",
    "[simulation]",
    "[simulation.disturbance]",
    "[simulation.perturbation]",
    "[simulation.channel]",
]


def with_key(table: str, line: str) -> str:
    """SMALL with one more line in a table, which is added where it is not there."""
    if not table:
        return f"{line}\n{SMALL}"
    if f"{table}\n" in SMALL:
        return changed(f"{table}\n", f"{table}\n{line}\n")
    return f"{SMALL}\n{table}\n{line}\n"


@pytest.mark.parametrize("value", ["1.0", "[[1.0]]", '"x"', "{ x = 1 }"])
@pytest.mark.parametrize("key", ["A", "B", "C", "D"])
@pytest.mark.parametrize("table", TABLES)
def test_a_key_of_the_gains_is_unknown_in_every_other_table(table: str, key: str, value: str) -> None:
    with pytest.raises(ProblemError) as error:
        parse_problem(with_key(table, f"{key} = {value}"))
    message = str(error.value)
    assert f"unknown key `{key}`" in message
    assert message.startswith(table)
    assert f"`{key}` belongs in [design.fragility] or [[design.gains]]" in message


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ("[agent.parameters]", "{0} = 2.0"),
        ("[agent]", 'units = {{ p = "{0}" }}'),
        ("[design.fragility]", "{0} = 0.1"),
    ],
)
@pytest.mark.parametrize("key", ["A", "B", "C", "D"])
def test_a_key_of_the_gains_is_welcome_where_names_are_free(table: str, line: str, key: str) -> None:
    text = SMALL.replace("parameters = { k = 2.0, b = 3.0, c = 1.0 }", "").replace(
        "[agent.dynamics]", "[agent.parameters]\nk = 2.0\nb = 3.0\nc = 1.0\n[agent.dynamics]"
    )
    line = line.format(key)
    parse_problem(
        text.replace(f"{table}\n", f"{table}\n{line}\n") if table in text else f"{text}{table}\n{line}"
    )


@pytest.mark.parametrize(("state", "input_", "output"), [("A", "B", "C"), ("D", "C", "B"), ("B", "A", "D")])
def test_states_inputs_and_outputs_may_be_named_as_matrices(state: str, input_: str, output: str) -> None:
    agent = f'''
[agent]
states = ["{state}"]
inputs = ["{input_}"]
units = {{ {state} = "m" }}
domain = {{ {state} = [-1.0, 1.0] }}
dynamics = {{ {state} = "{input_} - sin({state})" }}
outputs = {{ {output} = "{state}" }}
'''
    problem = parse_problem(agent + '[network]\nagents = 2\ntopology = "path"\n')
    problem.validate()
    assert problem.agent().outputs == (output,)


@pytest.mark.parametrize(
    "table", ["agent.parameters", "agent.dynamics", "agent.outputs", "agent.domain", "agent.units"]
)
@pytest.mark.parametrize("key", ["A", "literal[x]", "tuple[x]"])
def test_a_wrong_value_of_a_name_of_the_user_is_told_with_its_place(table: str, key: str) -> None:
    text = "\n".join(line for line in SMALL.splitlines() if not line.startswith("parameters"))
    head = f"[{table}]\n"
    line = f'"{key}" = [[]]\n'
    with pytest.raises(ProblemError) as error:
        parse_problem(text.replace(head, head + line) if head in text else f"{text}\n{head}{line}")
    assert f"[{table}] {key}" in str(error.value)


def test_a_key_of_several_tables_is_told_with_all_of_them() -> None:
    with pytest.raises(ProblemError) as error:
        parse_problem(with_key("[network]", "controller = 1.0"))
    assert "`controller` belongs in the first lines, before any table or [design.weights]" in str(error.value)


def test_gains_that_are_one_table_are_told_as_such() -> None:
    with pytest.raises(ProblemError, match=r"\[design\] gains: `gains` is a table"):
        parse_problem(f"{SMALL}\n[design.gains]\nD = [[1.0]]\n")


def test_a_list_is_not_called_too_short_of_the_entries_that_are_refused():
    text = changed("[network]\n", "[network]\nspectrum = [0, 1]\n")
    with pytest.raises(ProblemError, match=r"spectrum, entry 1: found 0; expected two numbers") as error:
        parse_problem(text)
    assert "also" not in str(error.value)


LEADER = """
[agent]
states = ["p", "v"]
inputs = ["f"]
dynamics = { p = "v", v = "f - p**3" }
outputs = { y = "p" }
domain = { p = [-1.0, 1.0] }
[network]
agents = 2
topology = "leader_path"
[design]
objective = "initial_set"
disturbances = { states = %s }
"""


@pytest.mark.parametrize(
    ("scales", "least"), [("0.5", "0.5"), ("{ p = 1.0 }", "0"), ("{ p = 2, v = 0.1 }", "0.1")]
)
def test_a_set_of_initial_states_asks_for_a_gain_from_all_that_moves_the_states(scales, least):
    with pytest.raises(ProblemError) as raised:
        parse_problem(LEADER % scales)
    assert str(raised.value).startswith(f"[design.disturbances] states: a scale of {least}, and")
    assert "1 or more" in raised.value.remedy


def test_scales_of_one_and_more_or_noise_alone_leave_a_set_to_be_looked_for():
    for scales in ("1.0", "{ p = 1, v = 3 }"):
        assert not parse_problem(LEADER % scales).performance.states.min() < 1
    assert parse_problem(LEADER.replace("states = %s", "outputs = 0.1")).performance.covers_xi


def test_dynamic_controllers_and_errors_of_d_alone_are_no_contradiction():
    body = LEADER.partition("[design]")[0]
    assert parse_problem(body + "[design]\norder = 0\nfragility = { D = 0.1 }").fragility["D"] == 0.1
    assert parse_problem(body + "[design]\norder = 1\nfragility = { A = 0.1 }").fragility["A"] == 0.1
