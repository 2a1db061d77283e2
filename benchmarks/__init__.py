"""Mirror Scan measured against named peers, on the same input, in the same run: ``python -m benchmarks``.

One module a table: ``quality``, ``speed``, ``dtw``, ``imports``. ``scenes`` holds what is reconstructed, ``peers`` the
other programs' surface steps, ``results`` how tables are printed.
"""
