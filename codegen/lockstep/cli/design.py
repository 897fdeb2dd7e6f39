"""`lockstep design`: gains and certificate."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, left_from_before, progress_display, remark, two_columns, wrote
from lockstep.cli.interrupts import keeping_the_best
from lockstep.cli.messages import messages_row
from lockstep.lmi.diagnosis.open_loop import softer
from lockstep.lmi.specification.defaults import TRIED
from lockstep.model.agents.arguments import units_text
from lockstep.model.problem.tables.toml_text import value_text
from lockstep.workflow.design_file import slopes_text

REUSED = "the design was made before, of the same problem, and is proved again; --fresh searches anew"
HARDLY = ": these controllers hardly lower it; for a faster agreement ask for a `decay`, or a faster one"
HIDDEN = ": these controllers do hardly anything, and none is certified to be fast: {}; an [agent.domain] may leave that out"
SLOWER = ", and is more than is proved of the controllers that ship: ask for a `decay`, or a faster one"
WORSE = ": these controllers make it worse; is the period too long?"
LOCAL = "while every agent stays in its domain"
ONLY = "the continuous controllers only, NOT those that ship (below)"
NOTHING = "nothing is proved"
CONVERGES = "every disagreement at {:.6g} 1/s or faster, of the continuous controllers"
FLOOR = "rho >= {:.10g}: no controllers can certify less (proved)"
NO_FLOOR = "none was proved: how near rho is to the least possible is not known"
STATIC, LITTLE = 0.01, 1.5
"""Part of u, below which controllers' states do nothing; times the period, below which the longest one leaves little room."""
STATIC_SAID = (
    'the controllers\' states add less than {:.0%} to what their D do: these D alone spare them (method "given" with'
    " order 0, and these weights and disturbances; a search with order 0 finds others)"
)


def run(path: Path, output: Path | None, **options: Any) -> Answer:
    """Design, prove, and write the design file, and what rho costs if asked for: the options are those of `lockstep.design`.

    The exit status is 1 where the sampled controllers are not certified, or not with the decay that is asked for; the file is
    written all the same.
    """
    import lockstep
    from lockstep.workflow.build import unproved

    with left_from_before(output), progress_display() as tell, keeping_the_best(remark) as stop:
        found = lockstep.design(path, output=output, **options, progress=tell, remark=remark, stop=stop)
    if found.reused:
        remark(REUSED)
    wrote(output, options.get("trade_off"))
    said = found.document()
    survived = said.get("messages", {"certified": True})["certified"]
    return Answer(said, summary(said), not unproved(found.sampled) and survived)


def sampled_text(sampled: Mapping[str, Any]) -> str:
    """Return in a line what is proved of the sampled controllers."""
    reach = f"; certified at {most:g} s" if (most := sampled.get("max_period")) else ""
    reach += ", little above the period" * bool(most and 1 <= most / sampled["period"] < LITTLE)
    if failed := sampled.get("not_designed_for_period"):
        reach += f"; not designed for the period: {failed}"
    if sampled["certified"]:
        gain = f", rho {sampled['rho']:.6g}" if sampled.get("rho") else ""
        rate, asked = sampled.get("rate") or 0.0, sampled.get("rate_asked") or 0.0
        gain += (f", {rate:g} 1/s" + f", NOT the {asked:g} 1/s asked for" * (rate < asked)) * bool(rate)
        made = ", designed for it" if sampled.get("designed_for_period") else ""
        return f"yes, every {sampled['period']:g} s{made}{gain}, rounding included, proof: {sampled['proof']}{reach}"
    return f"NO: {sampled.get('reason') or 'not looked at'}{reach}"


def _defaults(figures: Mapping[str, Any]) -> dict[str, str]:
    """Return the row of what was asked for where the file names neither `weights` nor `gain_limit`."""
    asked = figures.get("defaults")
    if not asked:
        return {}
    shown = {key: _unlike_one(value) for key, value in asked.items() if key not in TRIED}
    said = ", ".join(f"{key} = {value_text(value)}" for key, value in shown.items() if value != {})
    tried = (f"{when}: {asked[key]}" for key, when in TRIED.items() if asked.get(key))
    return {"by default": "; ".join(filter(None, [said, *tried]))}


def _unlike_one(value: Any) -> Any:
    """Return a table without what is 1, which it is where nobody names it."""
    return {k: v for k, v in value.items() if v != 1.0} if isinstance(value, Mapping) else value


def _cut(figures: Mapping[str, Any]) -> dict[str, str]:
    limit = figures.get("time_limit")
    cut = "interrupted" if figures.get("interrupted") else limit and f"cut by the limit of {limit:g} s"
    return {"search": f"{cut}: which gains it had found by then depends on the machine"} if cut else {}


def proved_besides(
    content: Mapping[str, Any], proves: Callable[[str], bool] = lambda _claim: True
) -> dict[str, str]:
    """Return a row for each claim besides rho and alpha that is made and proved.

    Args:
        content: of a design, as `Design.document` has it.
        proves: whether a claim, by its name in the checker, is proved.
    """
    floor, decay, C = content.get("floor"), content.get("decay"), any(one["A"] for one in content["gains"])
    stable = "yes, each by itself" * bool(content.get("controllers_stable") and C)
    sought = content.get("method") == "certified" and not content["figures"].get("interrupted")
    limits, rest = content.get("limits") or {}, ", controllers at rest" * C
    rest += f", {LOCAL}" * (content.get("scope") == "local")
    clips = "inputs may be clipped" + f", and then {NOTHING}" * ("clipped_radius" not in limits)
    none = NOTHING * (content.get("limits") is not None)
    rows = {
        "certificate": ("slope bounds", slopes_text(content)),
        "floor": ("lower bound", FLOOR.format(floor) if floor else NO_FLOOR * sought),
        "decay": ("convergence", decay and CONVERGES.format(decay)),
        "controllers_stable": ("controllers stable", stable),
        "limits": ("no saturation", _within("from", limits, "", clips, rest) or none),
        "clipped": ("with saturation", _within("agreement from", limits, "clipped_", NOTHING, rest) or none),
    }
    return {name: said for claim, (name, said) in rows.items() if said and proves(claim)}


def _within(said: str, limits: Mapping[str, Any], of: str, beyond: str, rest: str) -> str:
    """Set a distance from agreement, and an ellipsoid in the units of the states, beside the start in the file.

    >>> _within("from", {"radius": 1.0, "start": 4.0, "times_start": 0.25}, "", "unknown", ", controllers at rest")
    'from |x_d(0)| <= 1, 0.25 times the start in the file (from there unknown), controllers at rest'
    """
    radius, axes, times, cut = (limits.get(of + key) for key in ("radius", "text", "times_start", "beyond"))
    if not (sets := [one for one in (radius and f"|x_d(0)| <= {radius:.6g}", axes) if one]):
        return ""
    start = f", {times:g} times the start in the file" if times else ""
    outside = f" (from there {cut or beyond})" if times and (times < 1 or cut) else ""
    return f"{said} {', or '.join(sets)}{start}{outside}{rest}"


def summary(content: Mapping[str, Any]) -> RenderableType:
    """Return what was designed and proved, for people."""
    figures, alone = content["figures"], content["figures"].get("rho_alone")
    ships, rho = content["sampled"]["certified"], max(content["rho"], content["sampled"].get("rho") or 0.0)
    lost, asked = figures.get("lost_mode"), content["sampled"].get("rate_asked")
    little = HIDDEN.format(lost) if lost else "" if asked else HARDLY
    idle = (WORSE if rho > alone >= content["rho"] else little) if alone and rho > 0.9 * alone else ""
    fast, kept = figures.get("decay_alone"), content["sampled"].get("rate") or content["decay"] or 0.0
    idle = idle or (f"; {fast:.3g} 1/s, which is proved{SLOWER * (0.9 * fast > kept)}" if fast else "")
    part, soft, norms = figures["part_of_states"], softer(figures), figures["gain_norms"]
    static = {} if part is None or part > STATIC else {"order": STATIC_SAID.format(STATIC)}
    weak = ", ".join(str(i) for i, of in enumerate(norms, 1) if 0 < 100 * of < max(norms))
    fragility = ", ".join(f"{letter} {delta:g}" for letter, delta in content["fragility"].items() if delta)
    yes, local = f"{'yes' if ships else ONLY}, proof: {content['proof']}", content.get("scope") == "local"
    return two_columns(
        content["title"],
        {
            # People read the first line: it does not leave out what is not certified.
            "certified": yes if content["certified"] else "no",
            "rho": f"{content['rho']:.6g}",
            "alpha": f"{content['alpha']:.9g}{units_text(content.get('scales', {}).values())}",
            **({"holds": LOCAL, "initial states": content["initial_set"]["text"]} if local else {}),
            **proved_besides(content),
            **({"gain uncertainty": fragility} if fragility else {}),
            **({"open loop": f"rho {alone:.4g}, with u = 0 (computed){idle}"} if alone else {}),
            **static,
            **({"weak gains": f"agent {weak}: below 1 % of the largest, as if it led"} if weak else {}),
            **({"constant disturbance": soft} if soft else {}),
            "sampled": sampled_text(content["sampled"]),
            **messages_row(content),
            **_defaults(figures),
            **_cut(figures),
        },
    )
