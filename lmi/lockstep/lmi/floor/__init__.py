"""A proved lower bound of rho, the floor: no controllers, however connected, can certify less.

It is a statement about this form of certificate: a quadratic storage function and the pair multipliers of `inequality`.

What every certificate satisfies once the gains are eliminated, and the dual points that contradict it, are the checker's:
`lockstep.check.floor`. Here are

program     dual points as a semidefinite program, in doubles
bisection   the largest rho that is proved
"""
