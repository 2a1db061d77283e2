"""Small numeric tools, independent of scans: products, sparse least squares, union-find, threads."""

__all__ = ["point_products", "sparse_least_squares", "threads", "union_find"]
