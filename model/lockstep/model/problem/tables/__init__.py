"""The tables of a problem file: their schema, how they are read and written, and what is wrong with one in words."""
