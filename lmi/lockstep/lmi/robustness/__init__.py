"""Structured singular values and disk margins of opened loops, of any number of channels, without Slycot.

`structured` one matrix; `d_scaling` its upper bound; `peak` over frequency; `disk` margins; `every_frequency` what is proved.
"""

from lockstep.lmi.robustness.disk import DiskMargin, both_sides, disk_margin, loops_at_a_time
from lockstep.lmi.robustness.every_frequency import proved_gain
from lockstep.lmi.robustness.peak import GainPeak, peak
from lockstep.lmi.robustness.structured import StructuredValue, structured_singular_value

__all__ = [
    "DiskMargin",
    "GainPeak",
    "StructuredValue",
    "both_sides",
    "disk_margin",
    "loops_at_a_time",
    "peak",
    "proved_gain",
    "structured_singular_value",
]
