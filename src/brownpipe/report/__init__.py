"""Everything that `brownpipe figures` writes: the files of `figures`, and one page with all results.

`page` puts a page together, `study` and `tradeoff` say what is on it. A page is one HTML file that needs no network and
no other file. The same dataset gives the same bytes.
"""
