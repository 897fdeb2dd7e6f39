"""What design a piece of C comes from, and what is claimed of it: in the header, in flash, and in the manifest."""

import re
from dataclasses import dataclass

from lockstep.codegen.manifest import digest_of, sha256
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
        return cls(given if _SHA256.fullmatch(given) else sha256(given), digest_of(dict(spec.certificate)))

    @property
    def word(self) -> str:
        """The first 32 bits of the design's hash, the last of them set: a C literal that is never 0.

        >>> Identity("c0ffee10" + 56 * "0", "").word
        '0xc0ffee11u'
        """
        return f"0x{int(self.design[:8], 16) | 1:08x}u"
