"""Network tests: thousands of runs of the closed loop in compiled C, held against the certificate.

`plan_of` says what is run, `run_campaign` runs it, here or on a Dask cluster, `replay` runs one of its runs again.
"""

from lockstep.campaign.campaign import Campaign, run_campaign, summary
from lockstep.campaign.compiled.engine import Batch, Engine, RunFigures
from lockstep.campaign.compiled.layout import Features, Layout
from lockstep.campaign.compiled.source import CampaignSource, continuous_source, sampled_source
from lockstep.campaign.compute import RunTable, compute
from lockstep.campaign.guarantee import Guarantee
from lockstep.campaign.plan import Plan, plan_of
from lockstep.campaign.replay import Replay, replay
from lockstep.check.continuous.inequality import Performance

__all__ = [
    "Batch",
    "Campaign",
    "CampaignSource",
    "Engine",
    "Features",
    "Guarantee",
    "Layout",
    "Performance",
    "Plan",
    "Replay",
    "RunFigures",
    "RunTable",
    "compute",
    "continuous_source",
    "plan_of",
    "replay",
    "run_campaign",
    "sampled_source",
    "summary",
]
