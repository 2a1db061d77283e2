"""Small numeric tools: products, rotations, sparse least squares, union-find, threads, ``njit``."""

__all__ = [
    "blas_threads",
    "isosurface",
    "kernel_linking",
    "kernel_warnings",
    "kernels",
    "point_products",
    "rotations",
    "sparse_least_squares",
    "srgb",
    "threads",
    "union_find",
]
