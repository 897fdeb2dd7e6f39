"""What is convex for given gains: the least rho, the largest alpha, limits that no gains pass, and rounding to a proof."""
