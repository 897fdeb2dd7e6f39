"""`arduino/`: a library in Arduino's layout, self-contained: the same headers and sources, and one header for all."""

from collections.abc import Mapping

from lockstep.check.errors import demand
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.view import folder_view
from lockstep.codegen.manifest import Manifest


def files(manifest: Manifest, product: Mapping[str, str]) -> dict[str, str]:
    """Return the library.

    Raises:
        ProblemError: float64, which a `double` of 32 bits, AVR's, cannot hold.
    """
    expected = '`real = "float32"` in [controller]: a `double` has 32 bits on AVR'
    demand(manifest.real == "float32", f"the arithmetic is {manifest.real}", "--arduino", expected)
    view = folder_view(manifest)
    library = {
        "arduino/library.properties": render("exports/library.properties.j2", **view),
        f"arduino/src/lockstep_{manifest.name}.h": render("exports/library.h.j2", **view),
    }
    for agent in manifest.agents:
        library[f"arduino/src/{agent.name}.h"] = product[f"include/{agent.name}.h"]
        library[f"arduino/src/{agent.name}.c"] = product[f"src/{agent.name}.c"]
    return library
