"""Patches joined along their boundaries by dynamic time warping."""
