"""The trusted checker: what decides whether a design has the properties its file claims. It imports nothing that searches."""
