"""What `make_gallery.py` is made of: the graph's drawing, the run and its pictures, and the pages."""
