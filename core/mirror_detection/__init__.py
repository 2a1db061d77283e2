"""Mirrors found without a click, or near one."""
