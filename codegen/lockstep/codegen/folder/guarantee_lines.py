"""The guarantee in lines, as the C's headers and the manifest phrase it: what is proved, assumed, and left, of a formation
and a leader's reference too."""

import re
from collections.abc import Mapping

from lockstep.codegen.emission.emit import claims

LINES = {"proved": "Proved", "covers": "Covered", "assumes": "Assumed", "remains": "Ultimate bound"}
LINES |= {"where": "Consensus trajectory", "messages": "Messages", "formation": "Formation"}
LINES |= {"leader": "Leader", "decay": "Convergence", "decay_sampled": "Convergence, sampled"}
LINES |= {"controllers": "Controllers", "limits": "No saturation", "disturbances": "Disturbances"}
LINES |= {"limits_gain": "No saturation, disturbed", "clipped": "With saturation"}
LINES |= {"constant disturbance": "Constant disturbance"}
"""Keys of the manifest's certificate, which `lockstep.codegen.from_design` fills."""


def lines_of(certificate: Mapping[str, str | float | bool | None]) -> list[tuple[str, str]]:
    """Return (heading, sentence) of each line; of a design without a proof, that it has none.

    >>> lines_of({"certified": True, "proof": "ball", "proved": "they agree", "rho": 3.0})
    [('Proved', 'they agree')]
    >>> lines_of({"certified": True, "limits": "|u| < 1", "decay": "2 1/s"})
    [('Convergence', '2 1/s'), ('No saturation', '|u| < 1')]
    >>> lines_of({"certified": True, "assumes": "no limit is met (see `limits`)"})
    [('Assumed', 'no limit is met (see No saturation)')]
    >>> lines_of({"certified": False, "proved": "they agree"})
    [('NOT CERTIFIED', 'no proof covers these gains')]
    """
    if certificate.get("certified") is not True:
        heading, _, sentence = claims(certificate)[0].partition(": ")
        return [(heading, sentence)]
    said = ((heading, str(certificate[key])) for key, heading in LINES.items() if certificate.get(key))
    return [
        (heading, re.sub(r"`(\w+)`", lambda key: LINES.get(key[1], key[1]), line)) for heading, line in said
    ]
