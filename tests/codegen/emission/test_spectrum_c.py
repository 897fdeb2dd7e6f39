"""C for every graph with a spectrum: one image, certified as such, whose lists hold no more than is proved."""

import json
import re

import pytest

import lockstep
from cart import cart
from lockstep.check.certify import certify
from lockstep.check.errors import ProblemError
from lockstep.workflow.explain import explain

PROBLEM = (
    cart("f")
    + """
[network]
spectrum = [1.0, 4.0]
[design]
method = "modal"
order = 0
starts = 1
gain_limit = 10.0
[controller]
period = 0.02
"""
)


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    root = tmp_path_factory.mktemp("spectrum")
    (root / "carts.toml").write_text(PROBLEM)
    lockstep.design(root / "carts.toml", output=root / "carts.json")
    lockstep.generate(root / "carts.json", root / "carts")
    return root


def copied(generated, place, changes):
    for path in (generated / "carts").rglob("*"):
        if path.is_file():
            to = place / path.relative_to(generated / "carts")
            to.parent.mkdir(parents=True, exist_ok=True)
            text = path.read_text()
            for pattern, new in changes.get(to.name, []):
                text = re.sub(pattern, new, text)
            to.write_text(text)
    return place


def test_every_claim_is_decided_by_the_numbers_in_the_c(generated):
    found = certify(generated / "carts")
    assert found.proved and {"code", "sampled", "sampled_rho"} <= set(found.verdicts)
    assert "a graph with its spectrum, in-degree 4 at most, a list holding 4" in found.verdicts["code"].reason
    assert lockstep.certify(generated / "carts").ok
    image = json.loads((generated / "carts" / "manifest.json").read_text())["image"]
    assert (image["agents"], image["max_neighbours"]) == (1, 4)


def test_it_is_explained_as_what_it_is_for_all_graphs_of_its_spectrum(generated):
    said = {one.name: one for one in explain(generated / "carts").proved}
    assert said["agreement"].value == "any number of agents"
    assert "nonzero Laplacian eigenvalues are from 1 to 4" in said["agreement"].meaning
    assert "at most 4 neighbours" in said["period"].meaning


def test_a_list_that_is_longer_than_what_is_proved_is_refused(generated, tmp_path):
    """Every neighbour more is a rounding more: the text of the C alone is consistent with five."""
    longer = {
        "cart_node.h": [(r"MAX_NEIGHBOURS 4", "MAX_NEIGHBOURS 5"), (r"\[4\]", "[5]")],
        "cart_node.c": [(r"\b4u\b", "5u"), (r"(list = \{\s*2u,\s*\{[^}]*)\}", r"\1, 0.0f}")],
    }
    found = certify(copied(generated, tmp_path / "longer", longer)).verdicts["code"]
    assert not found.proved


def test_another_gain_is_refuted(generated, tmp_path):
    changed = {"cart.c": [(r"(const float t1 = -?)(\d)", lambda m: f"{m[1]}{(int(m[2]) + 5) % 10}")]}
    found = certify(copied(generated, tmp_path / "gain", changed)).verdicts["code"]
    assert found.status == "refuted" and "gains" in found.reason


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"max_neighbours": 5}, "max-neighbours"),
        ({"table": "csv"}, "table"),
        ({"one_image": False}, "one graph"),
    ],
)
def test_what_one_graph_is_needed_for_is_refused(generated, tmp_path, options, where):
    with pytest.raises(ProblemError, match=where):
        lockstep.generate(generated / "carts.json", tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()
