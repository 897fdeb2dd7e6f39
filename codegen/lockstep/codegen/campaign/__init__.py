"""Network tests: thousands of runs of the closed loop in compiled C, held against the certificate.

`plan_of` says what is run, `run_campaign` runs it, here or on a Dask cluster, `replay` runs one of its runs again.
"""

from lockstep.codegen.campaign.campaign import Campaign, run_campaign, summary
from lockstep.codegen.campaign.compute import Table, compute
from lockstep.codegen.campaign.engine import Batch, Engine, Outcome
from lockstep.codegen.campaign.functions import Weights
from lockstep.codegen.campaign.guarantee import Guarantee
from lockstep.codegen.campaign.layout import Features, Layout
from lockstep.codegen.campaign.plan import Plan, plan_of
from lockstep.codegen.campaign.replay import Replay, replay
from lockstep.codegen.campaign.source import Source, continuous_source, sampled_source

__all__ = [
    "Batch",
    "Campaign",
    "Engine",
    "Features",
    "Guarantee",
    "Layout",
    "Outcome",
    "Plan",
    "Replay",
    "Source",
    "Table",
    "Weights",
    "compute",
    "continuous_source",
    "plan_of",
    "replay",
    "run_campaign",
    "sampled_source",
    "summary",
]
