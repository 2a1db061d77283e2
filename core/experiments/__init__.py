"""Experiments of the paper, repeated with this program's own functions."""
