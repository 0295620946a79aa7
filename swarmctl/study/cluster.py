"""Workers: processes of this machine, or those of a Dask scheduler on any machines.

The only module that imports distributed.
"""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, Generic, TypeVar

import distributed

T = TypeVar("T")
R = TypeVar("R")

CONNECT_S = 10.0
FREE_PORT = "127.0.0.1:0"
"""where the scheduler serves HTTP, also without a dashboard; the default port 8787 may be in use"""
TASKS_A_CORE = 2
"""tasks at the scheduler for each core, so that no worker waits for this process"""


class ClusterError(Exception):
    """No workers, or workers that cannot compute. The text says what to do."""


class Workers(Generic[T, R]):
    """Workers that compute tasks. A task whose worker dies is computed again by another worker."""

    def __init__(self, client: distributed.Client) -> None:
        self._client = client

    @property
    def n_cores(self) -> int:
        """The number of tasks that the present workers compute at once."""
        return sum(self._client.ncores().values())

    def outcomes(
        self, tasks: Iterator[T], function: Callable[..., R], arguments: Callable[[T], tuple[Any, ...]]
    ) -> Iterator[tuple[T, R]]:
        """Yield each task with `function(*arguments(task))`, as workers finish. Raises ClusterError.

        The next tasks are taken after the previous outcome has been used.
        """
        running: dict[distributed.Future[Any], T] = {}
        finished = distributed.as_completed()
        room = 1  # the first task compiles machine code for all
        try:
            while True:
                for task in islice(tasks, room):
                    future = self._client.submit(function, *arguments(task), pure=False)
                    running[future] = task
                    finished.add(future)
                if not running:
                    return
                future = next(finished)
                task = running.pop(future)
                yield task, _result(future, task)
                room = max(1, TASKS_A_CORE * self.n_cores - len(running))
        finally:
            self._client.cancel(list(running), force=True)


def _result(future: distributed.Future[Any], task: object) -> Any:
    try:
        return future.result()
    except distributed.KilledWorker as error:
        raise ClusterError(
            f"{task} ended {error.allowed_failures + 1} workers, perhaps for lack of memory; "
            "use fewer --workers, or see the logs of the workers [workers-died]"
        ) from error
    except (distributed.CancelledError, OSError) as error:
        raise ClusterError(
            f"the scheduler is lost ({error}); start it again and repeat the command [no-scheduler]"
        ) from error
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "swarmctl":
            raise
        raise ClusterError(
            "a worker has no swarmctl; install 'mavlink-swarmctl[study]' where the workers run [worker-other]"
        ) from error
    except Exception as error:
        error.add_note(f"while a worker computed {task}")
        raise


@contextmanager
def local_workers(n: int, *, processes: bool = True) -> Iterator[Workers[Any, Any]]:
    """Start `n` processes of this machine, or threads of this process, and end them afterwards."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    # Ctrl-C at a terminal reaches all processes, and only this one shall act on it. Workers inherit the
    # ignored signal.
    on_interrupt = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        cluster = distributed.LocalCluster(
            n_workers=n,
            threads_per_worker=1,
            processes=processes,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": FREE_PORT},
            silence_logs=logging.CRITICAL,
        )
    finally:
        signal.signal(signal.SIGINT, on_interrupt)
    with cluster, distributed.Client(cluster) as client:
        yield Workers(client)


@contextmanager
def workers_of(scheduler: str) -> Iterator[Workers[Any, Any]]:
    """Connect to the workers of a scheduler, such as tcp://10.0.0.5:8786. Raises ClusterError."""
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"no scheduler answers at {scheduler}: {error}; start one by `dask scheduler`, or leave out "
            "--scheduler [no-scheduler]"
        ) from error
    with client:
        yield Workers(client)
