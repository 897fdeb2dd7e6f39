"""A proved lower bound of rho: the projected inequalities of one agent and the dual points that contradict them."""
