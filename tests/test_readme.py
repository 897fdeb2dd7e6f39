"""What the README shows runs."""

import re


def test_the_python_example_runs(root):
    blocks = re.findall(r"```python\n(.*?)```", (root / "README.md").read_text(), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        names: dict[str, object] = {}
        exec(compile(block, "README.md", "exec"), names)
        assert names["loop"].A_0.shape == (2 * 3 + 2 * 4,) * 2


def test_ci_finds_its_two_commands(root):
    commands = re.findall(r"```sh\n(.*?)\n```", (root / "README.md").read_text(), flags=re.DOTALL)
    assert "lockstep build" in commands[0]
    assert "pytest" in commands[1]
