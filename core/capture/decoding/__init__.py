"""Containers and codecs that several readers share."""

__all__ = ["binary", "depth_png", "file_indices", "lzf", "lzfse", "matroska", "openni_codec", "rosbag"]
