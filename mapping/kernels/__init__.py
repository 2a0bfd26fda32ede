"""The compiled loops, and the only place that imports numba.

Small functions over arrays, no classes. Importing this package costs nothing; its modules load
numba (about half a second), so the rooms import them inside the functions that need them. Every
kernel has a slow, obvious twin in the tests and gives the same result without compilation.
``error_model="numpy"`` leaves out the check for division by zero, which would keep a loop from
being vectorised.
"""
