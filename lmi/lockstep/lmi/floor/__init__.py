"""A proved lower bound of rho, the floor: no controllers, however connected, can certify less.

It is a statement about this form of certificate: a quadratic storage function and the pair multipliers of `inequality`.

projected   what every certificate satisfies once the gains are eliminated: two inequalities of a single agent
witness     dual points that contradict them, decided exactly; what `certify` decides again
program     dual points as a semidefinite program, in doubles
bisection   the largest rho that is proved
"""
