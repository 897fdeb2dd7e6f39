"""What Lie derivatives and brackets tell of an agent: ranks, relative degrees and zero dynamics."""
