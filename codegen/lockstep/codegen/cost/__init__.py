"""What a step of the C costs, and on which cores it is measured: stack, flash, instructions."""
