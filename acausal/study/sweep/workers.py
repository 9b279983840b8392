"""Workers that run the members of a sweep: this thread, processes, or any executor, in chunks of about half a second.

If a worker dies, its chunk is lost. All members submitted at that time are then run one by one, so that the member that
kills its process is identified, recorded as failed and not run again.
"""

from __future__ import annotations

import math
import multiprocessing
import multiprocessing.connection
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, Protocol

from acausal.errors import RunError, UsageError
from acausal.language.component import Component
from acausal.study.sweep.identity import fingerprint, referenced
from acausal.study.sweep.member import SENT, Outcome, Task, failed, forget, remember, run_chunk

Member = tuple[int, tuple[float, ...]]
Keep = Callable[[Sequence[Outcome]], None]

# Duration of a chunk [s], maximum size of its outcomes [bytes], and number of chunks submitted per worker.
_CHUNK, _BYTES, _AHEAD = 0.5, 16e6, 2


class Workers(Protocol):
    """Workers to which chunks of members are submitted."""

    capacity: int
    """Largest number of chunks submitted at a time."""

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        """Submit a chunk."""
        ...

    def renew(self) -> bool:
        """Start new workers after one of them has died; False if this is impossible."""
        ...

    def stop(self, at_once: bool) -> None:
        """Stop the workers when they are idle, or at once."""
        ...


class CallingThread:
    """Runs chunks in the calling thread."""

    capacity = 1

    def __init__(self, task: Task) -> None:
        self.key = str(id(task))
        remember(self.key, task)

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        done: Future[list[Outcome]] = Future()
        done.set_result(run_chunk(self.key, None, members))
        return done

    def renew(self) -> bool:
        return False

    def stop(self, at_once: bool) -> None:
        forget(self.key)


class Processes:
    """Processes of this machine; with `fork` they inherit the model, which then need not be picklable."""

    def __init__(self, task: Task, width: int) -> None:
        self.task, self.width, self.capacity = task, width, _AHEAD * width
        self.key = str(id(task))
        # the default method elsewhere, because fork is not safe on macOS and does not exist on Windows
        kind = "fork" if sys.platform.startswith("linux") else None
        self._context: Any = multiprocessing.get_context(kind)
        self._start()

    def _start(self) -> None:
        """Start the processes, and remember which child processes are not of this pool."""
        self._others = set(multiprocessing.active_children())
        self.pool = ProcessPoolExecutor(self.width, self._context, _initialise, (self.key, self.task))

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        with warnings.catch_warnings():
            # Python 3.12 warns of threads at a fork; BLAS, which has them here, handles forks itself
            warnings.simplefilter("ignore", DeprecationWarning)
            return self.pool.submit(run_chunk, self.key, None, members)

    def renew(self) -> bool:
        self.stop(at_once=True)
        self._start()
        return True

    def stop(self, at_once: bool) -> None:
        if at_once:
            # the loop of a solver in C does not react to anything gentler
            for child in set(multiprocessing.active_children()) - self._others:
                child.terminate()
        self.pool.shutdown(wait=not at_once, cancel_futures=True)


class GivenExecutor:
    """An executor given by the user: the model is sent with each chunk, and unpacked once by each worker."""

    def __init__(self, task: Task, executor: Executor, width: int) -> None:
        self.executor, self.capacity = executor, _AHEAD * width
        self.pickled = pickled(task)
        self.key = f"{os.getpid()} {id(task)} {time.time_ns()}"

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        return self.executor.submit(run_chunk, self.key, self.pickled, members)

    def renew(self) -> bool:
        return False

    def stop(self, at_once: bool) -> None:
        pass


def _initialise(key: str, task: Task) -> None:
    """Initialise a worker process: it ends with its parent, ignores Ctrl-C, and discards its standard error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (for the life of the process)
    remember(key, task)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """Exit when the process of the sentinel has ended."""
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def pickled(task: Task) -> bytes:
    """A pickled task, with the source of a model that was given by the path of its file.

    With `cloudpickle`, a dependency of Dask, it may contain anonymous functions.

    Raises UsageError: AC064 if something in the model cannot be pickled.
    """
    return pickle.dumps((_source_files(task.component), referenced(task.model), fingerprint(task.model), _dumps(task)))


def _dumps(task: Task) -> bytes:
    """The pickled task; AC064."""
    try:
        return pickle.dumps(task)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        problem = str(error)
    try:  # also pickles anonymous functions, such as those of inputs
        from cloudpickle import dumps

        return bytes(dumps(task))
    except (ImportError, pickle.PicklingError, TypeError, AttributeError) as error:
        raise UsageError(
            "AC064",
            f"{task.model.name} cannot be sent to the workers of this executor",
            evidence=[problem, str(error)],
            help="put classes and functions into a module, at its top; or leave the executor out",
        ) from error


def _source_files(component: Component | None) -> list[tuple[str, str, str]]:
    """(Name, path, source) of the module of a model that cannot be imported by name, because its path was given.

    The modules in the folder of its file follow, so that a worker notices when one of them has changed.
    """
    module = sys.modules.get(type(component).__module__)
    if component is None or module is None or module.__name__ == "__main__" or not module.__file__:
        return []
    if PathFinder.find_spec(module.__name__.partition(".")[0]) is not None:
        return []
    if SENT not in vars(module):
        folder = Path(module.__file__).parent
        beside = {n: p for n, m in sys.modules.items() if (p := getattr(m, "__file__", None)) and m is not module}
        near = {n: p for n, p in sorted(beside.items()) if Path(p).parent == folder and p.endswith(".py")}
        files = {module.__name__: module.__file__, **near}
        setattr(module, SENT, [(n, p, Path(p).read_text(encoding="utf-8")) for n, p in files.items()])
    sent: list[tuple[str, str, str]] = vars(module)[SENT]
    return sent


def run_all(team: Workers, task: Task, members: Sequence[Member], pace: float, keep: Keep) -> None:
    """Run all members; `keep` is called with the outcomes of each chunk, `pace` is the estimated time of a member [s].

    Raises RunError: AC413 if workers are lost and cannot be replaced.
    Raises UsageError: AC064 if a worker cannot load the model.
    """
    missing, suspects = deque(members), deque[Member]()
    running: dict[Future[list[Outcome]], Sequence[Member]] = {}
    elapsed, count = pace, 1
    size_limit = max(1, int(_BYTES / (8.0 * (1 + task.grid.size) * len(task.signals))))
    at_once = True
    try:
        while missing or suspects or running:
            # a member that may kill its process runs alone
            if suspects:
                if not running:
                    chunk: Sequence[Member] = [suspects.popleft()]
                    running[_submit(team, chunk)] = chunk
            else:
                while missing and len(running) < team.capacity:
                    even = math.ceil(len(missing) / team.capacity)
                    size = min(size_limit, even, max(1, int(_CHUNK * count / max(elapsed, 1e-6))))
                    chunk = [missing.popleft() for _ in range(min(size, len(missing)))]
                    running[_submit(team, chunk)] = chunk
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk = running.pop(future)
                outcomes = _collect(team, task, future, chunk, running, suspects)
                keep(outcomes)
                for outcome in outcomes:
                    if math.isfinite(outcome.seconds):
                        elapsed, count = elapsed + outcome.seconds, count + 1
                if suspects:
                    break
        at_once = False
    finally:
        for future in running:
            future.cancel()
        team.stop(at_once)


def _submit(team: Workers, chunk: Sequence[Member]) -> Future[list[Outcome]]:
    """The future of a chunk; of a broken executor one with its exception."""
    try:
        return team.submit(chunk)
    except BrokenExecutor as error:
        broken: Future[list[Outcome]] = Future()
        broken.set_exception(error)
        return broken


def _collect(
    team: Workers,
    task: Task,
    future: Future[list[Outcome]],
    chunk: Sequence[Member],
    running: dict[Future[list[Outcome]], Sequence[Member]],
    suspects: deque[Member],
) -> list[Outcome]:
    """The outcomes of a chunk; if its worker was lost, the failure of a single member, or none and more `suspects`."""
    try:
        return future.result()
    except (BrokenExecutor, CancelledError) as error:
        lost = [*chunk]
        for other in list(running):
            if not other.done() or other.cancelled() or other.exception() is not None:
                lost += running.pop(other)
        if not team.renew():
            raise RunError(
                "AC413",
                "the workers of the executor are gone",
                evidence=[f"{type(error).__name__}: {error}"],
                help="a sweep with a file keeps its finished members: repeat it with resume",
            ) from error
        if len(lost) > 1:
            suspects.extend(lost)
            return []
        return [failed(task, chunk[0][0], "AC412", "its process ended without a message: a crash, or no memory left")]
    except (ImportError, pickle.UnpicklingError) as error:
        raise UsageError(
            "AC064",
            f"the workers cannot load {task.model.name}",
            evidence=[f"{type(error).__name__}: {error}"],
            help="install its modules, and the same versions of acausal and CasADi, on the workers; restart those that "
            "have imported what has changed since; move classes of a script into a file of their own",
        ) from error
    except Exception as error:
        if len(chunk) > 1:
            suspects.extend(chunk)
            return []
        return [failed(task, chunk[0][0], "AC412", f"its worker failed: {type(error).__name__}: {error}")]
