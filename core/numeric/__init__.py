"""Small numeric tools that know nothing of scans: products, sparse least squares, union-find, threads."""
