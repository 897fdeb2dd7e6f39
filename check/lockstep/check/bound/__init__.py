"""The slopes of a nonlinearity, exactly as expressions and enclosed on boxes by outward-rounded interval arithmetic."""
