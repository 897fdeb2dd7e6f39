"""The `lockstep` command. Each command's work is in a module of its own, imported when it is called."""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, ParamSpec

import typer
from typer.core import TyperGroup

from lockstep.cli.interrupts import insistent_interrupts

if TYPE_CHECKING:
    from lockstep.cli.console import Answer

P = ParamSpec("P")


@contextmanager
def _answered() -> Iterator[None]:
    """Answer an interrupt that comes before the command's own work has begun, while it is loaded.

    Raises:
        typer.Exit: with the status of an interrupt.
    """
    try:
        yield
    except KeyboardInterrupt:
        _respond("--json" in sys.argv[1:], _interrupt)


def _respond(as_json: bool, work: "Callable[P, Answer]", /, *given: P.args, **named: P.kwargs) -> None:
    """Answer with what the work of a command returns."""
    from lockstep.cli.console import respond

    respond(as_json, lambda: work(*given, **named))


def _interrupt() -> NoReturn:
    raise KeyboardInterrupt


class Commands(TyperGroup):
    """The commands, of which each is answered, even where Typer itself would leave without a word."""

    def make_context(self, *given: Any, **named: Any) -> Any:
        """Read the command line."""
        with _answered():
            return super().make_context(*given, **named)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _answered(), insistent_interrupts():
            return super().invoke(ctx)


app = typer.Typer(
    name="lockstep",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode="rich",
    help="From nonlinear agents and a graph to certified H-infinity consensus controllers in embedded C.",
    epilog="Exit status: 0 every claim holds, 1 a claim does not hold, 2 the input is bad.",
)

LARGEST_SEED = 2**63 - 1
"""As in a problem file."""

MOST_RUNS = 2**31 - 1
"""Runs are counted in a machine word."""


def _flag(name: str, says: str) -> Any:
    """Return an option that is there or is not."""
    return typer.Option(name, help=says)


_option = partial(typer.Option, show_default=False)
_output = partial(_option, "-o", "--output")

_IMAGE = "One image for all nodes, their neighbours given at run time; or C for each agent."

Json = Annotated[bool, _flag("--json", "One JSON object on standard output.")]
ProblemFile = Annotated[
    Path, typer.Argument(metavar="PROBLEM", help="A problem file (TOML).", show_default=False)
]
DesignFile = Annotated[
    Path,
    typer.Argument(metavar="DESIGN", help="A design file, or a folder that holds one.", show_default=False),
]
Folder = Annotated[Path, _output(help="The folder to write.")]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="Processes to search with.", show_default="one per core")
]

TradeOff = Annotated[
    Path | None, _option(metavar="DIR", help="What rho costs, proved; FILE.csv: rho for each alpha.")
]
Against = Annotated[list[Path] | None, _option(help="A file with gains of these agents, shown there.")]

TimeLimit = Annotated[
    float | None,
    _option(min=0.01, help="Seconds to search, and as many for the period; then the best so far."),
]

Fresh = Annotated[bool, _flag("--fresh", "Search anew, even if the same problem was solved before.")]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, _flag("--version", "Print the version.")] = False) -> None:
    if version:
        from importlib.metadata import version as installed

        typer.echo(f"lockstep {installed('lockstep-control')}")
        raise typer.Exit


@app.command()
def init(
    field: Annotated[
        str, typer.Argument(metavar="[FIELD]", help="arms, platoon, rooms, ...", show_default="to fill in")
    ] = "blank",
    output: Annotated[Path | None, _output(help="The file to write.")] = None,
    json: Json = False,
) -> None:
    """Begin a commented problem file."""
    from lockstep.cli.init_explain import run_init

    _respond(json, run_init, field, output)


@app.command()
def check(
    problem: ProblemFile,
    boxes: Annotated[
        int | None, _option(min=1, help="Boxes for the proof of the bound; then the best enclosure so far.")
    ] = None,
    every: Annotated[
        bool, _flag("--all", "Also equilibria, sectors, passivity, contraction, ranks and units.")
    ] = False,
    messages: Annotated[
        bool, _flag("--messages", "Of a design: which losses and delays it carries.")
    ] = False,
    json: Json = False,
) -> None:
    """Check a model symbolically: bound, structure, graph."""
    from lockstep.cli.check import run

    _respond(json, run, problem, boxes=boxes, every=every, messages=messages)


@app.command()
def design(
    problem: ProblemFile,
    output: Annotated[Path | None, _output(help="Where to write the design.")] = None,
    trade_off: TradeOff = None,
    against: Against = None,
    time_limit: TimeLimit = None,
    jobs: Jobs = None,
    scheduler: Annotated[str | None, _option(help="Address of a Dask scheduler for the search.")] = None,
    fresh: Fresh = False,
    json: Json = False,
) -> None:
    """Design the gains, and prove the loop with those very gains; Ctrl-C keeps the best so far."""
    from lockstep.cli.design import run

    asked = {"trade_off": trade_off, "against": against or [], "time_limit": time_limit, "jobs": jobs}
    _respond(json, run, problem, output, reuse=not fresh, scheduler=scheduler, **asked)


@app.command()
def certify(
    design: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DESIGN]", help="A design file, or a folder that holds one.", show_default=False
        ),
    ] = None,
    lmi: Annotated[
        Path | None, _option(help="Instead: a linear matrix inequality with a point (JSON).")
    ] = None,
    json: Json = False,
) -> None:
    """Check a design's proof, or an inequality of yours, independently: no solver, exact arithmetic."""
    from lockstep.cli.certify import run

    _respond(json, run, design, lmi)


@app.command()
def explain(design: DesignFile, json: Json = False) -> None:
    """Say in plain words what is proved of a design and what is not."""
    from lockstep.cli.init_explain import run_explain

    _respond(json, run_explain, design)


@app.command()
def generate(
    design: DesignFile,
    output: Folder,
    optimize: Annotated[str, typer.Option(help='"speed" unrolls, "size" loops over a table.')] = "speed",
    pil: Annotated[
        bool, _flag("--pil", "Test vectors and a runner for any board, for `verify --from`.")
    ] = False,
    fmu: Annotated[bool, _flag("--fmu", "FMI 3.0 co-simulation units.")] = False,
    rust: Annotated[bool, _flag("--rust", "A Rust crate over the C.")] = False,
    arduino: Annotated[bool, _flag("--arduino", "A library in Arduino's layout.")] = False,
    messages: Annotated[
        bool, _flag("--messages", "The message layer: stamped differences, refusals counted.")
    ] = False,
    dbc: Annotated[bool, _flag("--dbc", "The messages as a DBC, for CAN FD.")] = False,
    fixed: Annotated[bool, _flag("--fixed", "Controllers in integers, certified too.")] = False,
    name: Annotated[str, typer.Option(help="The CMake target's and the umbrella header's name.")] = "",
    prefix: Annotated[
        str, typer.Option(help="Put before the agents' names: two designs fit one program.")
    ] = "",
    one_image: Annotated[bool | None, _option("--one-image/--per-agent", help=_IMAGE)] = None,
    max_neighbours: Annotated[int | None, _option(min=1, max=64, help="Of a node of one image.")] = None,
    table: Annotated[str, _option(help='Whom each node hears: "none", "csv" or "c".')] = "none",
    json: Json = False,
) -> None:
    """Emit C for each agent's controller."""
    from lockstep.cli.build import generate as run

    wanted = (pil, fmu, rust, arduino, messages, dbc, fixed)
    exports = [*compress(("pil", "fmu", "rust", "arduino", "messages", "dbc", "fixed"), wanted)]
    image = {"one_image": one_image, "max_neighbours": max_neighbours, "table": table}
    names = {"name": name, "prefix": prefix}
    _respond(json, run, design, output, optimize=optimize, exports=exports, **names, **image)


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A generated folder.", show_default=False)],
    steps: Annotated[
        int, typer.Option(min=1, help="Closed-loop steps, and as many adversarial ones.")
    ] = 10_000,
    target: Annotated[
        list[str] | None,
        typer.Option(help="host, sanitizers or a core; may be repeated.", show_default="all of them"),
    ] = None,
    run_changed: Annotated[
        bool, _flag("--run-changed", "Compile and run files that were changed, too.")
    ] = False,
    log: Annotated[
        Path | None, _option("--from", metavar="LOG", help="Compare a board's log of pil/ instead.")
    ] = None,
    json: Json = False,
) -> None:
    """Compile and run the C, and compare it, bit by bit, with the Python reference."""
    from lockstep.cli.verify import run

    asked = {"targets": target or None, "run_changed": run_changed, "log": log}
    _respond(json, run, folder, steps=steps, **asked)


@app.command()
def simulate(
    design: DesignFile,
    output: Annotated[Path | None, _output(help="Where to write the trajectory (CSV).")] = None,
    controllers: Annotated[
        str | None,
        typer.Option(
            help='"continuous", "sampled" (the arithmetic that ships), "compiled" (a generated folder), or "off" (u = 0).',
            show_default="sampled",
        ),
    ] = None,
    horizon: Annotated[float | None, typer.Option(help="Seconds.", show_default="the problem's")] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=LARGEST_SEED, help="Of all that is random.", show_default="the problem's"),
    ] = None,
    disturbance: Annotated[
        str | None,
        typer.Option(
            help='"none", "noise", "sine", "step" or "worst" (searched for).', show_default="the problem's"
        ),
    ] = None,
    perturbation: Annotated[
        str | None,
        typer.Option(
            help='Gain errors of continuous controllers: "none", "paper", "paper_scaled" or "random".',
            show_default="the problem's",
        ),
    ] = None,
    integrator: Annotated[str, typer.Option(help='"rk4" or "adaptive".')] = "rk4",
    send_on_change: Annotated[
        float | None, _option(min=0.0, metavar="C", help="Send where an output has changed by more than C.")
    ] = None,
    plot: Annotated[bool, _flag("--plot", "Plot in the terminal; into files: `--figures`.")] = False,
    figures: Annotated[
        Path | None, _option(help="Draw the run as PNG and PDF in this folder.", metavar="DIR")
    ] = None,
    campaign: Annotated[
        int | None,
        _option(min=1, max=MOST_RUNS, help="So many random runs instead of one; `-o` is their folder."),
    ] = None,
    scheduler: Annotated[str | None, _option(help="Address of a Dask scheduler for the campaign.")] = None,
    replay: Annotated[
        int | None, _option(min=0, max=MOST_RUNS, help="This run of a campaign again, by its number.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Threads of the campaign.", show_default="one per core")
    ] = None,
    faults: Annotated[
        str | None,
        _option(metavar="LIST", help="Of a campaign: messages lost or late, loss=0.5,delay=0:5, ..."),
    ] = None,
    json: Json = False,
) -> None:
    """Simulate the nonlinear closed loop, against what is proved of it."""
    from lockstep.cli.simulate import run
    from lockstep.workflow.runs.simulate_options import Many, Options

    options = Options(
        controllers, horizon, seed, disturbance, integrator, plot, perturbation, figures, send_on_change
    )
    many = Many(campaign, replay, output, scheduler, jobs, faults)
    _respond(json, run, design, options, many, as_json=json)


@app.command()
def build(
    problem: ProblemFile,
    output: Folder,
    trade_off: Annotated[bool, _flag("--trade-off", "Show what rho costs in the report.")] = False,
    against: Against = None,
    time_limit: TimeLimit = None,
    jobs: Jobs = None,
    fresh: Fresh = False,
    json: Json = False,
) -> None:
    """All of the above, and a report."""
    from lockstep.cli.build import run

    asked = {"trade_off": trade_off, "against": against or [], "time_limit": time_limit, "jobs": jobs}
    _respond(json, run, problem, output, reuse=not fresh, **asked)


@app.command()
def reproduce(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[CLAIM]...", help="Claims by name.", show_default="all")
    ] = None,
    output: Annotated[Path | None, _output(help="Where to write the page (Markdown).")] = None,
    figures: Annotated[
        Path | None, _option(help="Make Section 4's figures and table in this folder instead.", metavar="DIR")
    ] = None,
    json: Json = False,
) -> None:
    """Settle the paper's claims, each with its verdict and the figure."""
    from lockstep.cli.reproduce import run

    _respond(json, run, names or [], output, figures)


def main() -> None:
    """Run the command; with `--json`, what is wrong with the command line itself is an object too."""
    if not sys.warnoptions:
        # What a library remarks in the middle of a computation is no answer; `python -W default` shows it.
        warnings.simplefilter("ignore")
    as_json = "--json" in sys.argv[1:]
    try:
        with _answered():
            status = app(standalone_mode=not as_json)
    except typer.Exit as left:
        status = left.exit_code
    except Exception as error:
        # Typer brings its own copy of click's exceptions, or click's, by version: known by what they can do.
        if not hasattr(error, "format_message"):
            raise
        from lockstep.cli.console import misused

        status = misused(str(error.format_message()))
    sys.exit(status)
