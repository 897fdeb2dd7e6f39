"""Certificates of others: a linear matrix inequality as plain matrices, with a point, decided exactly.

`lmi_file` the format; `decide` the decision; `write` documents from matrices, Gram matrices and cvxpy problems.
"""

from lockstep.lmi.external_lmi.decide import ConstraintVerdict, LmiVerdict, decide_lmi
from lockstep.lmi.external_lmi.lmi_file import Constraint, Lmi
from lockstep.lmi.external_lmi.write import (
    document_of_cvxpy,
    document_of_gram,
    document_of_matrices,
    rounded_gram,
)

__all__ = [
    "Constraint",
    "ConstraintVerdict",
    "Lmi",
    "LmiVerdict",
    "decide_lmi",
    "document_of_cvxpy",
    "document_of_gram",
    "document_of_matrices",
    "rounded_gram",
]
