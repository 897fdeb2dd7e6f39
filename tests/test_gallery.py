"""The gallery: its pages show what the committed designs claim, and those are proved, compiled, compared and run again."""

import json
import re
import sys
from pathlib import Path

import pytest

import lockstep
from lockstep.model.problem import Problem
from lockstep.workflow.init import fields, init

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "docs" / "gallery"
NOTEBOOKS = ROOT / "docs" / "notebooks"

sys.path.insert(0, str(ROOT / "docs"))
import make_gallery  # noqa: E402
from gallery_maker import measure, pages  # noqa: E402
from gallery_maker.scenes import SCENES  # noqa: E402

DESIGNED = fields()
"""Each has a committed design."""

INSTRUCTIONS = 0.25
"""Another version of a compiler may take so much more or less of them."""

PICTURE, MOVING, DESIGN = 200_000, 500_000, 120_000
"""The most bytes of a committed file of each kind."""


def test_the_gallery_is_what_the_script_makes(update):
    made = make_gallery.files()
    if update:
        for name, content in made.items():
            (GALLERY / name).write_text(content, encoding="utf-8")
    drawn = {f"{field}-{what}.png" for field in DESIGNED for what in ("states", "disagreement")}
    moving = {f"{field}-moving.svg" for field in SCENES}
    assert {path.name for path in GALLERY.iterdir()} == {*made, *drawn, *moving, "designs", "measured.json"}
    stale = [name for name, text in made.items() if (GALLERY / name).read_text(encoding="utf-8") != text]
    assert stale == [], "pytest tests/test_gallery.py --update accepts it"


def test_every_field_has_a_design_and_there_are_ten():
    assert set(measure.known()) == set(DESIGNED)
    assert len(DESIGNED) >= 10


def test_what_is_committed_is_small():
    for paths, most in (("*.png", PICTURE), ("*-moving.svg", MOVING), ("designs/*.json", DESIGN)):
        assert all(path.stat().st_size <= most for path in GALLERY.glob(paths))


@pytest.mark.parametrize("field", DESIGNED)
def test_the_design_is_of_the_fields_file(field):
    posed, design = Problem.parse(init(field).text), lockstep.load(measure.design_path(field))
    own, agent = design.problem.file.agent, posed.file.agent
    assert own.units.items() <= agent.units.items(), "units of parameters came after some of the designs"
    assert own.model_copy(update={"units": agent.units}) == agent
    for part in ("network", "controller"):
        assert getattr(design.problem.file, part) == getattr(posed.file, part)
    for key in posed.design.model_fields_set - {"gains"}:
        assert getattr(design.problem.design, key) == getattr(posed.design, key)
    for agent, given in enumerate(posed.design.gains or ()):
        assert design.gains.D[agent].tolist() == [list(row) for row in given.D]
    assert (design.problem.initial_states() == posed.initial_states()).all()


@pytest.mark.parametrize("field", DESIGNED)
def test_no_gain_is_at_its_limit_without_a_word(field):
    design = lockstep.load(measure.design_path(field))
    page = (GALLERY / f"{field}.md").read_text(encoding="utf-8")
    if design.problem.design.method == "given":
        assert "The gains are those of the file" in page
        return
    at_limit = pages.largest(design) >= pages.AT_LIMIT * design.problem.design.gain_limit
    assert ("it binds, and on purpose" in page) == at_limit
    assert ("it does not bind" in page) != at_limit


@pytest.mark.slow
@pytest.mark.parametrize("field", DESIGNED)
def test_the_design_is_proved_compiled_and_run_again(field):
    design = lockstep.load(measure.design_path(field))
    assert lockstep.certify(design).ok
    assert design.sampled["certified"] is True
    known, run = measure.known()[field], lockstep.simulate(design)
    found = measure.measure(field, run)  # generates, which proves the C's numbers, and compares every bit
    assert found["costs"] == known["costs"]
    assert found["instructions"] == pytest.approx(known["instructions"], rel=INSTRUCTIONS)
    first = known["run"]["disagreement"][0]
    assert run.ok
    assert found["run"]["disagreement"] == pytest.approx(
        known["run"]["disagreement"], rel=0.02, abs=1e-3 * first
    )
    assert found["run"]["input"] == pytest.approx(known["run"]["input"], rel=0.02)
    assert found["run"]["ratio"] == pytest.approx(known["run"]["ratio"], rel=0.02)
    assert found["run"]["covered"] is known["run"]["covered"] is True


@pytest.mark.slow
def test_a_design_that_claims_better_than_its_floor_is_refused():
    content = json.loads(measure.design_path("robots").read_text(encoding="utf-8"))
    content["claims"]["rho"] = 0.99 * content["claims"]["floor"]
    assert not lockstep.certify(lockstep.Design.of(content, "robots")).ok


def test_a_header_that_says_nothing_of_the_core_is_told():
    with pytest.raises(ValueError, match="RAM"):
        measure.costs(["nothing"])


def test_five_notebooks_are_of_fields_and_linked():
    found = {path.stem for path in NOTEBOOKS.glob("*.ipynb")}
    assert len(found) >= 5
    assert found <= set(fields())
    index = (NOTEBOOKS / "index.md").read_text(encoding="utf-8")
    assert all(f"({field}.ipynb)" in index for field in found)


def posed_in(notebook: dict) -> str:
    """The problem file in the first cell of code."""
    first = next("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code")
    return first.split('"""')[1].strip()


def posed_by(field: str) -> str:
    """A field's file from its title on."""
    text = init(field).text
    return text[text.index("title = ") :].strip()


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_poses_the_problem_of_its_field(path):
    shown = posed_in(json.loads(path.read_text(encoding="utf-8")))
    assert shown == posed_by(path.stem)
    assert shown != posed_by("rooms")


def printed(notebook) -> list[str]:
    """What each cell prints; pictures, tables of HTML, standard error, and the digits that a search ends with, aside."""
    said = [
        "".join(one.text for one in cell.outputs if one.output_type == "stream" and one.name == "stdout")
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]
    return [re.sub(r"\b[0-9a-f]{64}\b|-?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?", "#", text) for text in said]


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_prints_what_is_committed(path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    before = printed(notebook)
    assert any(before)
    place = {"metadata": {"path": str(NOTEBOOKS)}}
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3", resources=place).execute()
    assert printed(notebook) == before
