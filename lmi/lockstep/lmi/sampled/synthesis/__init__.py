"""Gains for the period by smooth descent on rho of the sampled loop: in doubles, for the search."""
