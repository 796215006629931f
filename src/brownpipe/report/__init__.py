"""What is written of a dataset, and web pages.

`products` writes all that `brownpipe figures` makes, `page` puts it on one page, `replay` makes that of one run. A page
is one HTML file that needs no network and no other file. The same dataset or run gives the same bytes.
"""
