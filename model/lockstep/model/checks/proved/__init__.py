"""Model checks that prove: each Proved, Refuted with a witness, or Undecided. A file here states one property and decides it.

What is searched for (a metric, a storage function, a point) is a proposal in doubles; what decides is exact arithmetic or
interval arithmetic (`lockstep.check.bound.enclosure`) over boxes. A budget counts boxes, never seconds.
"""
