"""Long work beside the window: jobs, the second Python, kernels compiled beforehand."""

__all__ = [
    "compiled_code",
    "getting_ready",
    "job_operators",
    "kernel_compilation",
    "last_problem",
    "numba_setup",
    "second_process",
]
