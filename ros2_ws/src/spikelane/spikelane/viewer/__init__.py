"""What a robot does, live in the browser: what is shown, and the server that shows it.

Rerun's web viewer, as it alone of those on PyPI brings its page with it: it works without a
network, whereas Foxglove's SDK needs an application from elsewhere to look at what it serves.
Rerun is large (177 MB to download, with pyarrow) and hence installed only when it is asked for.
"""
