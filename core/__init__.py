"""Mirror Scan's algorithms: numpy and numba only, nothing of Blender.

Data flows one way through the modules:
capture -> depth -> mirror -> views -> triangulation -> zippering -> closing -> pipeline.
Nothing here imports numba at package import; each module with kernels does so on first use.
"""
