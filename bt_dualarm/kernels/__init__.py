"""What has to be fast, as machine code: how numba is used here.

In: functions on numbers and arrays, in modules called ``…_kernels.py`` beside what calls them.
Out: the same functions, compiled, their code kept in the user's cache directory.
Open first: `kernel` (the decorator, the first compilation); `kernel_folder` has where code lies.
"""
