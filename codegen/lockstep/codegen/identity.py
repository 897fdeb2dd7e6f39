"""What design a piece of C comes from, and what is claimed of it: in the header, in flash, and in the manifest."""

import hashlib
import json
import re
from dataclasses import dataclass

from lockstep.codegen.spec import CodegenSpec

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class Identity:
    """SHA-256 of the design's content and of its claims, in hexadecimal."""

    design: str
    claims: str

    @classmethod
    def of(cls, spec: CodegenSpec) -> "Identity":
        """Return the identity of what is generated; a design hash of another form is hashed itself."""
        given = spec.design_hash
        claims = json.dumps(dict(spec.certificate), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return cls(given if _SHA256.fullmatch(given) else _sha256(given), _sha256(claims))

    @property
    def word(self) -> str:
        """The first 32 bits of the design's hash, the last of them set: a C literal that is never 0.

        >>> Identity("c0ffee10" + 56 * "0", "").word
        '0xc0ffee11u'
        """
        return f"0x{int(self.design[:8], 16) | 1:08x}u"


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
