"""`build` writes a report with what it proves, and says so, with exit status 1, where the C that ships is not proved."""

import json

import pytest
from typer.testing import CliRunner

import lockstep.workflow.build as build
from lockstep.check.errors import ClaimError
from lockstep.cli.main import app
from lockstep.lmi.document import answer_document as said
from lockstep.lmi.document import read
from lockstep.verification.verify import VerifyReport

KEYS = {"ok", "directory", "check", "design", "verify", "files", "report", "problems", "notes"}


@pytest.fixture
def quick(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(build, "VERIFY_STEPS", 50)
    monkeypatch.setattr(build, "VERIFY_TARGETS", ("host",))
    return lambda *words: CliRunner().invoke(app, ["build", *map(str, words), "--json"])


@pytest.mark.slow
def test_build_exits_1_where_the_sampled_controllers_are_not_proved(examples, quick, tmp_path):
    # 0.2 s is six times the longest period that is certified for the published gains
    text = (examples / "table_1.toml").read_text()
    (tmp_path / "slow.toml").write_text(text.replace("period = 0.005", "period = 0.2"))
    result = quick("slow.toml", "-o", "out")
    answer = json.loads(result.stdout)
    assert result.exit_code == 1
    assert set(answer) == KEYS
    assert not answer["ok"]
    assert answer["design"]["certified"], "the continuous controllers are"
    assert not answer["design"]["sampled"]["certified"]
    (problem,) = answer["problems"]
    assert "sampled controllers are not certified" in problem
    assert "at a period of" in problem
    assert "to be noted: period: 0.2 s is" in problem, "what may be why is beside what failed"
    header = (tmp_path / "out" / "include" / "arm1.h").read_text()
    said = " ".join(header.replace("\n *", " ").split())
    assert "the continuous controllers are certified (proof: exact); THE C OF THIS FOLDER IS NOT" in said
    assert "nothing is proved of the sampled, rounded one here" in said
    page = (tmp_path / "out" / answer["report"]).read_text()
    assert "not certified" in page


@pytest.mark.slow
def test_c_that_differs_from_its_reference_is_not_written(examples, quick, tmp_path, monkeypatch):
    def wrong(*_):
        return VerifyReport(False, (), (), ("arm1 differs in call 3",))

    monkeypatch.setattr(build, "_verified", wrong)
    result = quick(examples / "table_1.toml", "-o", "out")
    answer = json.loads(result.stdout)
    assert (result.exit_code, answer["files"], answer["report"]) == (1, [], None)
    assert answer["problems"] == ["arm1 differs in call 3"]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_build_writes_the_report_twice_the_same(examples, quick, tmp_path):
    result = quick(examples / "table_1.toml", "-o", "out")
    answer = json.loads(result.stdout)
    assert result.exit_code == 0, result.output
    assert set(answer) == KEYS
    assert answer["problems"] == []
    written = sorted(
        p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*") if p.is_file()
    )
    assert answer["files"] == written
    assert answer["report"] == "report.html"
    assert answer["design"] == json.loads(json.dumps(said(read(tmp_path / "out" / "design.json"))))
    first = {name: (tmp_path / "out" / name).read_bytes() for name in written}
    assert quick(examples / "table_1.toml", "-o", "out").exit_code == 0
    assert first == {name: (tmp_path / "out" / name).read_bytes() for name in written}


@pytest.mark.parametrize(
    ("sampled", "said"),
    [
        ({"certified": True}, []),
        ({"certified": False, "reason": "why", "max_period": None}, ["not certified: why"]),
        ({"certified": "yes"}, ["not looked at"]),
        ({}, ["not looked at"]),
    ],
)
def test_only_a_proof_counts_as_one(sampled, said):
    found = build.unproved(sampled)
    assert len(found) == len(said)
    assert all(part in one for one, part in zip(found, said, strict=True))


@pytest.mark.slow
def test_a_build_that_finds_no_gains_says_what_is_seldom_meant(tmp_path):
    """A start outside of the domain, in other units: of a plant that no gains of so small a norm stabilise."""
    file = tmp_path / "problem.toml"
    file.write_text(
        '[agent]\nstates = ["x"]\ninputs = ["u"]\ndynamics = { x = "x + 0.1*sin(x) + u" }\noutputs = { y = "x" }\n'
        'domain = { x = [-1.0, 1.0] }\n[network]\nagents = 2\ntopology = "path"\n[design]\norder = 0\ngain_limit = 0.1\n'
        "starts = 1\n[simulation]\ninitial = [[500.0], [0.0]]\n"
    )
    with pytest.raises(ClaimError, match=r"to be noted: .*x of agent 1 is 500, outside of \[agent.domain\]"):
        build.build(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_nodes_that_a_claim_on_messages_is_of_are_written_and_compared(quick, tmp_path):
    """What `[network.messages]` asks for is proved of stamped differences: without the nodes the claim is of no C."""
    (tmp_path / "cells.toml").write_text(
        """
        [agent]
        name = "cell"
        states = ["x"]
        inputs = ["u"]
        dynamics = { x = "u - 0.3*x + 0.2*tanh(x)" }
        outputs = { y = "x" }
        [network]
        agents = 2
        topology = "path"
        messages = { loss = 0.1 }
        [design]
        method = "given"
        order = 0
        gains = [{ D = [[-1.0]] }, { D = [[-1.0]] }]
        [controller]
        period = 0.01
        """
    )
    answer = json.loads((result := quick("cells.toml", "-o", "out")).stdout)
    assert result.exit_code == 0
    assert answer["design"]["messages"]["certified"]
    assert (tmp_path / "out" / "messages" / "cell1_node.c").is_file()
    ran = [target for target in answer["verify"]["targets"] if not target.get("skipped")]
    assert {node["agent"] for target in ran for node in target["nodes"]} == {"cell1", "cell2"}
