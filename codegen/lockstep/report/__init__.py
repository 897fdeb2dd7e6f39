"""What a build shows for itself: one page that needs no network, its figures, and a short text for the terminal.

figures   a network and its runs as matplotlib figures, for whoever has a `Trajectory`
spectrum  poles and singular values, by python-control
page      the page
report    all of it for a folder about to be written
section4  the paper's figures 3, 4, 5 and its Table 2 again, for `lockstep reproduce --figures`
"""

from lockstep.report.report import Report, make_report

__all__ = ["Report", "make_report"]
