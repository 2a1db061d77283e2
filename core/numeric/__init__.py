"""Small numeric tools, independent of scans: products, sparse least squares, union-find, threads, ``njit``."""

__all__ = ["kernel_warnings", "kernels", "point_products", "sparse_least_squares", "threads", "union_find"]
