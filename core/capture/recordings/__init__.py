"""Readers of recordings, a file each."""
