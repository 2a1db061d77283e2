"""Depth: a burst becomes one map, its noise is measured, each view is cleaned."""
