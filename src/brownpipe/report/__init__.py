"""The output of `brownpipe figures`, and web pages.

`products` writes all that `brownpipe figures` makes, `page` puts it on one page, which begins with
the scenes in words (`description`) and in motion (`typical_run`) and with the answer in sentences
(`answer`); `replay` makes the page of one run. A page is one HTML file that needs no network and no
other file. The same dataset or run gives the same bytes.
"""
