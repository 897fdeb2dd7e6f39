"""The message layer of a generated folder against its reference: every bit, on every target."""
