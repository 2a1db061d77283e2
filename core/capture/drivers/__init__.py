"""Cameras other than RealSense, by their makers' packages: each one function that opens a :class:`.stream.Stream`."""

__all__ = ["azure_kinect", "orbbec", "stream"]
