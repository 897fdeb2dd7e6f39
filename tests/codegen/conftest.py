"""Makes the cases here and what tests share between rooms importable, these tests being no package, and keeps the loops that
several files run."""

import json
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), *(str(one) for one in sorted(HERE.iterdir()) if one.is_dir())]


@pytest.fixture(scope="session")
def generated(root):
    """The committed C of the arms, with its design."""
    return root / "generated" / "flexible_joint_arms"


@pytest.fixture(scope="session")
def arms_problem(examples):
    from lockstep.model.problem import load_problem

    return load_problem(examples / "flexible_joint_arms.toml")


@pytest.fixture(scope="session")
def arms_network(examples):
    from campaign_cases import arms_of

    return arms_of(examples)


@pytest.fixture(scope="session")
def continuous(arms_network):
    """The compiled loop with the continuous controllers, their gains uncertain."""
    from campaign_cases import DELTA, continuous_loop

    from lockstep.campaign import Engine, Features

    features = Features(waves=True, noise=True, sequences=True, uncertain=True)
    return Engine(continuous_loop(arms_network, features=features, fragility=DELTA))


@pytest.fixture(scope="session")
def sampled(arms_network):
    """The compiled loop with the C that ships, messages being lost."""
    from campaign_cases import emitted, sampled_loop

    from lockstep.campaign import Engine, Features

    features = Features(waves=True, noise=True, sequences=True, drops=True)
    return Engine(sampled_loop(arms_network, emitted(arms_network.graph), features))


@pytest.fixture(scope="session")
def unclipped(generated, tmp_path_factory):
    """The committed design without limits of its inputs, and without what is claimed of them."""
    content = json.loads((generated / "design.json").read_text())
    content["problem"]["agent"]["limits"] = None
    for key in ("radius", "limits_gain", "clipped_radius", "half_axes", "clipped_half_axes"):
        content["claims"]["sampled"][key] = None
    for key in ("radius", "limits_gain", "clipped"):
        content["proofs"][key] = None
    path = tmp_path_factory.mktemp("unclipped") / "design.json"
    path.write_text(json.dumps(content))
    return path
