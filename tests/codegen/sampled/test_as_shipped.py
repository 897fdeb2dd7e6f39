"""From a design to one whose sampled controllers are proved, or that says by how much they are not."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.check.errors import Infeasible, NotCertified
from lockstep.check.system.loop import Gains
from lockstep.cli.main import app
from lockstep.codegen import period_redesign
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of
from lockstep.model.problem import Problem

LINEAR = """
title = "Two carts, linear"

[agent]
name = "cart"
states = ["p", "v"]
inputs = ["f"]

[agent.dynamics]
p = "v"
v = "f"

[agent.outputs]
y1 = "p"
y2 = "v"

[network]
agents = 2
edges = [[1, 2], [2, 1]]

[design]
method = "METHOD"
order = 0
gain_limit = 20.0
starts = 1
GAINS

[controller]
period = PERIOD
"""

FAST = "\n[[design.gains]]\nD = [[-6.0, -6.0]]\n" * 2
"""The difference of the carts obeys e'' = -12 e - 12 e': certified, and unstable when they are held for half a second: of
e+ = M e with held inputs, det M = 1 - 12 T + 6 T^2 is -3.5 at T = 0.5."""


def designed(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.toml").write_text(text)
    result = CliRunner().invoke(app, ["design", "p.toml", "-o", "d.json", "--json"])
    return result.exit_code, json.loads(result.stdout)


def problem(method, period, gains=""):
    text = LINEAR.replace("METHOD", method).replace("PERIOD", period)
    return text.replace("GAINS", "") + gains


def test_given_gains_that_their_period_breaks_exit_1_and_say_by_how_much(tmp_path, monkeypatch):
    code, answer = designed(tmp_path, monkeypatch, problem("given", "0.5", FAST))
    assert answer["certified"], "the continuous controllers are"
    sampled = answer["sampled"]
    assert (code, sampled["certified"]) == (1, False)
    assert sampled["spectral_radius"] > 1
    assert "spectral radius" in sampled["reason"]
    assert 0 < sampled["max_period"] < 0.5
    assert "given" in sampled["not_designed_for_period"]
    assert (tmp_path / "d.json").exists(), "a continuous certificate is worth keeping"


def test_the_same_gains_at_a_short_period_exit_0(tmp_path, monkeypatch):
    code, answer = designed(tmp_path, monkeypatch, problem("given", "0.005", FAST))
    assert (code, answer["sampled"]["certified"]) == (0, True)
    assert answer["sampled"]["rho"] > 0


@pytest.mark.slow
@pytest.mark.parametrize(("period", "redesigned"), [("0.5", True), ("0.005", False)])
def test_a_time_limit_ends_a_design_for_the_period_and_is_told_where_there_was_one(period, redesigned):
    stored = design_file_of(design(Problem.parse(problem("certified", period))))
    made = period_redesign.as_shipped(stored, time_limit=1e-9)
    assert (made.info["figures"].get("time_limit") == 1e-9) == redesigned
    said = made.info["sampled"]
    assert (
        bool(
            said.get("designed_for_period")
            or "the time limit was over" in said.get("not_designed_for_period", "")
        )
        == redesigned
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objective", "period", "held"), [("rho", "0.005", 0.0), ("decay", "0.005", None), ("decay", "0.5", 0.5)]
)
def test_gains_with_the_fastest_decay_are_designed_for_the_period_only_where_it_breaks_them(
    objective, period, held, monkeypatch
):
    """Where any rho of the sampled loop is too large: a descent on rho would spend the decay, so half of it is held."""
    asked = problem("certified", period).replace("starts = 1", f'starts = 1\nobjective = "{objective}"')
    stored, searched = design_file_of(design(Problem.parse(asked))), []

    def improved(at, *_args, **_options):
        searched.append(at.decay)

    monkeypatch.setattr("lockstep.lmi.sampled.synthesis.gains_for_period.redesigned", improved)
    monkeypatch.setattr(period_redesign, "NEAR", 0.0)
    period_redesign.as_shipped(stored)
    assert searched == ([] if held is None else [held * stored.claims.decay])


@pytest.mark.slow
def test_a_linear_agent_is_designed_for_its_period(tmp_path, monkeypatch):
    code, answer = designed(tmp_path, monkeypatch, problem("certified", "0.5"))
    assert (code, answer["sampled"]["certified"]) == (0, True)
    assert answer["sampled"]["designed_for_period"]
    assert not answer["figures"]["replaced"]["sampled_rho"], "the continuous design breaks there"


@pytest.mark.parametrize(
    ("sector", "rhos", "kept"),
    [
        (None, [9.0], 9.0),
        ("of entries", [9.0, 7.8, 5.6, 5.59], 5.59),  # a fall of less than 1 % ends it
        ("of entries", [9.0, 9.5], 9.0),
        ("of entries", [9.95], 9.95),  # of the continuous design's 10, too
        ("of entries", [9.0, 8.0, 7.0, 6.0], 6.0),
    ],
)
def test_gains_are_designed_again_in_the_sector_of_their_own_certificate(monkeypatch, sector, rhos, kept):
    """Each round begins with the best design before; without a sector there is one round. The bar never runs back."""
    asked, left, parts = [], iter(rhos), []
    stored = SimpleNamespace(claims=SimpleNamespace(sampled=SimpleNamespace(rho=10.0)))

    def proved(design, effort, _least):
        asked.append(design)
        effort.tell(0.0)
        effort.tell(1.0)
        rho = next(left)
        return f"design of {rho}", None, rho

    monkeypatch.setattr(period_redesign, "_proved_for_period", proved)
    monkeypatch.setattr(period_redesign, "sampled_network", lambda _stored: SimpleNamespace(sector=sector))
    monkeypatch.setattr(period_redesign, "with_figures", lambda made, _stored: made)
    monkeypatch.setattr(period_redesign, "with_sampled", lambda made, _held, **_remarks: made)
    effort = period_redesign.Effort(parts.append)
    assert period_redesign.designed_for_period(stored, effort) == f"design of {kept}"
    assert asked == [stored, *(f"design of {rho}" for rho in rhos[:-1])]
    assert next(left, None) is None
    assert parts == sorted(parts)
    assert 0.0 == parts[0] < parts[-1] <= 1.0


@pytest.mark.parametrize(("least", "proves"), [(10.0, False), (np.inf, True)])
def test_gains_that_a_design_for_the_period_leaves_as_they_are_are_not_proved_again(
    monkeypatch, least, proves
):
    """Half a minute of four trackers. Where nothing is proved of them sampled yet, other multipliers may prove it."""
    gains = Gains.from_blocks(np.ones((2, 1, 1)), 0)
    stored, made = SimpleNamespace(gains=gains), []
    held = SimpleNamespace(verdict=SimpleNamespace(certified=True), rho=SimpleNamespace(rho=9.0))
    monkeypatch.setattr(period_redesign, "_searched", lambda _stored, _effort: (gains, None))
    monkeypatch.setattr(period_redesign, "with_gains", lambda _stored, found: made.append(found) or "made")
    monkeypatch.setattr(period_redesign, "prove_design", lambda _made, _m: held)
    if proves:
        assert period_redesign._proved_for_period(stored, None, least) == ("made", held, 9.0)
    else:
        with pytest.raises(Infeasible, match="smaller rho of the sampled loop than 10"):
            period_redesign._proved_for_period(stored, None, least)
    assert made == ([gains] if proves else [])


@pytest.mark.parametrize(
    ("real", "asked", "claimed"), [("float32", "", False), ("float64", "", True), ("float32", "stable", None)]
)
def test_controllers_that_rounding_leaves_without_decay_are_not_said_to_be_stable(real, asked, claimed):
    """x_C' = -1e-9 x_C decays; every 0.5 s it is 1 - 5e-10, which float32, 2^-24 apart there, rounds to 1.

    Where it is asked for, they are refused.
    """
    one = "{ A = [[-1e-9]], B = [[0.0]], C = [[0.0]], D = [[-0.1]] }"
    text = f"""
    [agent]
    states = ["x"]
    inputs = ["u"]
    dynamics = {{ x = "-x + u" }}
    outputs = {{ y = "x" }}
    [network]
    agents = 2
    topology = "complete"
    [controller]
    period = 0.5
    real = "{real}"
    [design]
    method = "given"
    order = 1
    gains = [{one}, {one}]
    {"stable_controllers = true" * bool(asked)}
    """
    if claimed is None:
        with pytest.raises(
            NotCertified, match="agent 1 is not stable by itself as it ships, rounded to float32"
        ):
            lockstep.design(Problem.parse(text))
        return
    made = lockstep.design(Problem.parse(text))
    assert made.stored.claims.controllers_stable is claimed
    assert lockstep.certify(made)
