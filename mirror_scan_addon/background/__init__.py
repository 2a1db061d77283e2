"""Long work beside the window: jobs, the second Python, kernels compiled beforehand."""
