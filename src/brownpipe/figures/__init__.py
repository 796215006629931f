"""The figures and the summary of a study, from its dataset alone.

`catalogue` lists the figures, one module each, and `render` draws them. `cases` selects the parts
of a dataset that are shown, `style` sets the one style of all figures. Bands and bars are 95 %
intervals over runs. The same dataset gives the same bytes.
"""
