"""Write the gallery: a page, a drawing of the graph and the pictures of a run for each field of `lockstep init`.

    python docs/make_gallery.py                    the pages and the graphs, from the designs and what was measured
    python docs/make_gallery.py --measure [FIELD]  proves, compiles and runs the committed designs first
    python docs/make_gallery.py --design FIELD     makes the design of a field anew, which takes minutes, and measures it

All of it is committed, so that it can be read without the site; tests/test_gallery.py holds it to the fields.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import lockstep
from gallery_maker.graph import drawing
from gallery_maker.measure import FOLDER, design_path, keep, known, measure, pictures
from gallery_maker.pages import index, page, parts
from lockstep.model.problem import Problem
from lockstep.workflow.init import fields, init
from lockstep.workflow.output_files import write_text


def files() -> dict[str, str]:
    """Return the files of the gallery that are text, by name."""
    made = {"index.md": index()}
    for field in fields():
        made[f"{field}.md"] = page(field)
        made[f"{field}.svg"] = drawing(parts(field)[0])
    return made


def design_again(field: str) -> None:
    """Make the design of a field, and keep it if it is certified as it ships.

    Raises:
        ClaimError: it is not.
    """
    found = lockstep.design(Problem.parse(init(field).text))
    if found.sampled["certified"] is not True:
        raise lockstep.ClaimError(f"{field}: {found.sampled['reason']}")
    found.save(design_path(field))


def measure_again(field: str) -> None:
    """Prove, compile and run a committed design, and write its figures and pictures."""
    simulation = lockstep.simulate(design_path(field))
    keep(field, measure(field, simulation))
    for name, content in pictures(field, simulation).items():
        (FOLDER / name).write_bytes(content)


def main() -> None:
    """Do what the options say."""
    options = argparse.ArgumentParser(description="Write the gallery.")
    options.add_argument("--design", metavar="FIELD", nargs="+", choices=fields(), default=[])
    options.add_argument("--measure", metavar="FIELD", nargs="*", choices=fields())
    asked = options.parse_args()
    for field in asked.design:
        design_again(field)
    for field in (*asked.design, *(known() if asked.measure == [] else asked.measure or ())):
        measure_again(field)
    for name, content in files().items():
        write_text(FOLDER / name, content)


if __name__ == "__main__":
    main()
