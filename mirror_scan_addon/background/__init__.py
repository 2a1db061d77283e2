"""Long work beside the window: jobs, the second Python, kernels compiled beforehand."""

__all__ = ["getting_ready", "job_operators", "kernel_compilation", "numba_setup", "second_process", "tasks"]
