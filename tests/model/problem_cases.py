"""Problem files: the worked example, a small one, the same with given gains, and changes of one place."""

from pathlib import Path

ARMS = (Path(__file__).parents[2] / "examples" / "flexible_joint_arms.toml").read_text(encoding="utf-8")

SMALL = """
title = "small"
[agent]
name = "cart"
states = ["p", "v"]
inputs = ["f"]
parameters = { k = 2.0, b = 3.0, c = 1.0 }
[agent.dynamics]
p = "v"
v = "-k*p - sin(p) + b*f"
[agent.outputs]
y1 = "c*p"
[network]
agents = 3
edges = [[1, 2], [2, 3], [3, 1]]
[design]
order = 1
[controller]
period = 0.01
[simulation]
horizon = 5
"""

GIVEN = SMALL.replace("order = 1", 'method = "given"')
GAINS = """
[[design.gains]]
A = [[-1.0, 0.5], [0.0, -2.0]]
B = [[1.0], [2.0]]
C = [[3.0, 4.0]]
D = [[5.0]]
"""


def changed(old: str, new: str, text: str = SMALL) -> str:
    assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
    return text.replace(old, new)
