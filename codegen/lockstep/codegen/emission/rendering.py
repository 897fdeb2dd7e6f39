"""Jinja templates, which print C, CMake, Markdown and HTML: those of every package are read here, under the same rules."""

from typing import Any

import jinja2


def templates(package: str, **options: Any) -> jinja2.Environment:
    """Return the templates in a package's folder `templates`: a name that is not given is an error, a tag leaves no line.

    options: of `jinja2.Environment`, where a package has other rules.
    """
    rules = {
        "undefined": jinja2.StrictUndefined,
        "trim_blocks": True,
        "lstrip_blocks": True,
        "keep_trailing_newline": True,
        "autoescape": False,
    }
    return jinja2.Environment(loader=jinja2.PackageLoader(package, "templates"), **{**rules, **options})


_OURS = templates("lockstep.codegen")


def render(template: str, **values: Any) -> str:
    """Fill a template of `lockstep.codegen`."""
    return _OURS.get_template(template).render(**values)
