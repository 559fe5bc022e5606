"""Report of a regression run: one self-contained HTML page (extra `report`).

Its text is the template `page.html`; Matplotlib draws the plots as SVG inside it. The page needs no network, no script
and no other file, and the same results give the same page, to the byte.
"""
