"""The only package that imports matplotlib: a page → the bytes of a picture."""
