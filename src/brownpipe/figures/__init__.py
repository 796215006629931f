"""The figures and the summary of a study, from its dataset alone.

`needs.FIGURES` has the names of the figures, one module each with its record, `FIGURE`; `render`
draws them. `cases` splits a dataset into its cases, `style` sets the one style of all figures.
Bands and bars are 95 % intervals over runs. The same dataset gives the same bytes.
"""
