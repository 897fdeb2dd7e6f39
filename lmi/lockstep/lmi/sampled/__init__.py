"""The certificate of the controllers that ship: sampled, held, in rounded floating point, proved in ball arithmetic.

The decision is the checker's: `lockstep.check.sampled`. Here are

search       the multiplier under which the gain around the nonlinearity is small, in doubles
storage      the inequality as a Riccati inequality in P, and the two ends of its solutions, in doubles
candidates   witnesses for it, those that pass little noise on first, in doubles
certify      the search for a witness of agreement; `lockstep.check.sampled.certificate` decides
performance  the search for a small rho of the sampled loop; `lockstep.check.sampled.l2_gain` decides
period       the largest period that is certified
tustin       the discrete controllers as functions of the gains
slopes       one lifted period, with its slopes
response     a loop's frequency response as one smooth number, with its slopes
objective    both loops, sampled and continuous, as functions of gains, multiplier and rho
descent      descent on rho of the sampled loop
improve      design for the period: the best of what descents reach from several starts
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
