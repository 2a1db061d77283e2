"""Many tasks over the cores of this machine, or over a cluster, by Dask.

Importing this brings neither Dask nor numba.
"""

from .code_version import program_version
from .task_runner import ClusterError, Outcome, TaskRunner, WorkerSettings, start_workers

__all__ = ["ClusterError", "Outcome", "TaskRunner", "WorkerSettings", "program_version", "start_workers"]
