"""Containers and codecs that several readers share."""
