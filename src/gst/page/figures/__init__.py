"""Every figure of the study, drawn from stored results only: nothing is solved here.

Each function ``NAME_figure`` takes datasets and tables as the stages store them and returns a
matplotlib figure, which `gst.page.figures.style.save_figure` writes. The captions in
``workflow/report`` explain signs and colours.
"""
