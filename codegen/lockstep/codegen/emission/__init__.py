"""From a design to the text of its C: what the templates see, the statements of the kernels, the files."""
