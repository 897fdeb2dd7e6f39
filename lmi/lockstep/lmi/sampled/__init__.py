"""The certificate of the controllers that ship: sampled, held, in rounded floating point, proved in ball arithmetic.

The decision is the checker's: `lockstep.check.sampled`. Here are

loop_gain    the multiplier under which the gain around the nonlinearity is small, in doubles
storage      the inequality as a Riccati inequality in P (`riccati`), and the two ends of its solutions, in doubles
step_program the same as a convex program in P and the pair weights, without rounding
candidates   witnesses for it, those that pass little noise on first, in doubles
witnesses    the search for a witness of agreement; `lockstep.check.sampled.certificate` decides
l2_gain      the search for a small rho of the sampled loop; `lockstep.check.sampled.l2_gain` decides
input_limits, saturation   from where no input meets its limit, and from where the clipped loop converges
period       the largest period that is certified
fixed_point  the same of controllers in integers
modal, messages, synthesis   mode by mode; with messages lost or late; gains designed for the period
"""

from lockstep.check.sampled.certificate import SampledVerdict
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.lmi.sampled.l2_gain import SampledRho, sampled_rho
from lockstep.lmi.sampled.period import max_period
from lockstep.lmi.sampled.witnesses import certify_sampled

__all__ = [
    "HeldController",
    "SampledNetwork",
    "SampledRho",
    "SampledVerdict",
    "certify_sampled",
    "max_period",
    "sampled_rho",
]
