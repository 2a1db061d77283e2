"""Readers of captures that are folders."""
