"""A problem as the text of a TOML file: the keys that differ from their defaults, each number as it is."""

from collections.abc import Mapping
from typing import Any

from lockstep.model.problem.tables.schema import ProblemFile

ASKED_FOR = ("weights", "gain_limit")
"""Keys of [design] that mean something by being there: a file without any of them asks for more than rho."""

_LONGEST_LINE = 100


def toml_text(file: ProblemFile) -> str:
    """Return the text of a problem file; reading it gives the same tables again.

    >>> tables = {"agent": {"states": ["x"], "inputs": ["u"], "dynamics": {"x": "u"}, "outputs": {"y": "x"}},
    ...           "network": {"agents": 2, "topology": "path"}, "design": {"order": 0}}
    >>> print(toml_text(ProblemFile.model_validate(tables)))
    [agent]
    states = ["x"]
    inputs = ["u"]
    <BLANKLINE>
    [agent.dynamics]
    x = "u"
    <BLANKLINE>
    [agent.outputs]
    y = "x"
    <BLANKLINE>
    [network]
    agents = 2
    topology = "path"
    <BLANKLINE>
    [design]
    order = 0
    <BLANKLINE>
    """
    import tomlkit

    tables = file.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    agent, named = tables["agent"], file.design.model_fields_set
    for key in ASKED_FOR:
        if key in named and key not in tables.get("design", {}):
            tables.setdefault("design", {})[key] = file.design.model_dump(mode="json", exclude_none=True)[key]
    agent["outputs"] = dict(agent["outputs"])
    if "domain" in agent:
        agent["domain"] = {state: _interval(*bounds) for state, bounds in agent["domain"].items()}
    document = tomlkit.item(tables)
    _break_lines(document)
    return tomlkit.dumps(document)


def value_text(value: Any) -> str:
    """Return one value, in a line, as a problem file would have it.

    >>> value_text({"input": [0.002], "outputs": {"y1": 3.0e-5, "y2": 1.0}}), value_text(True), value_text("certified")
    ('{input = [0.002], outputs = {y1 = 3e-05, y2 = 1.0}}', 'true', '"certified"')
    """
    return str(_in_a_line(value).as_string())


def _in_a_line(value: Any) -> Any:
    import tomlkit

    if not isinstance(value, Mapping):
        return tomlkit.item(value)
    table = tomlkit.inline_table()
    for key, one in value.items():
        table.append(key, _in_a_line(one))
    return table


def _interval(low: float | None, high: float | None) -> list[float]:
    """TOML has inf, where JSON has to leave a side out."""
    return [float("-inf") if low is None else low, float("inf") if high is None else high]


def _break_lines(item: Any) -> None:
    """Write a long matrix with one row per line."""
    import tomlkit.items

    if isinstance(item, tomlkit.items.Array):
        if len(item.as_string()) > _LONGEST_LINE:
            item.multiline(True)
    elif isinstance(item, tomlkit.items.AoT):
        for table in item:
            _break_lines(table)
    elif isinstance(item, tomlkit.items.Table):
        for inner in item.values():
            _break_lines(inner)
