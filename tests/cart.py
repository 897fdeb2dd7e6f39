"""A cart, the agent of tests in several folders."""


def cart(acceleration: str) -> str:
    """[agent] of a problem file: p'' as a formula in p, v = p' and the input f; p and v are seen."""
    return f"""
[agent]
name = "cart"
states = ["p", "v"]
inputs = ["f"]
dynamics = {{ p = "v", v = "{acceleration}" }}
outputs = {{ y1 = "p", y2 = "v" }}
"""
