"""Who runs the members: this thread, processes of this machine, or any executor, in chunks of about half a second.

A chunk is lost with its worker. What was in flight then is run again one member at a time, so that the one that ends
its process is found, recorded and not tried again.
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
from acausal.study.sweep.member import Outcome, Task, failed, forget, remember, run_chunk

Member = tuple[int, tuple[float, ...]]
Keep = Callable[[Sequence[Outcome]], None]

# Seconds of work in a chunk, bytes of its outcomes, and chunks that wait for each worker.
_CHUNK, _BYTES, _AHEAD = 0.5, 16e6, 2


class Crew(Protocol):
    """Somebody to hand chunks to."""

    flight: int
    """Chunks that it is given at a time."""

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        """Have a chunk run."""
        ...

    def renew(self) -> bool:
        """Make workers anew after one of them has died; False where that is not ours to do."""
        ...

    def stop(self, at_once: bool) -> None:
        """Let the workers go, or end them in the middle of their work."""
        ...


class Here:
    """This thread."""

    flight = 1

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
    """Processes of this machine; with `fork` they inherit the model, and nothing of it has to be picklable."""

    def __init__(self, task: Task, width: int) -> None:
        self.task, self.width, self.flight = task, width, _AHEAD * width
        self.key = str(id(task))
        # The system's own choice where a fork is not safe (macOS) or not there (Windows).
        kind = "fork" if sys.platform.startswith("linux") else None
        self._context: Any = multiprocessing.get_context(kind)
        self._made()

    def _made(self) -> None:
        self._others = set(multiprocessing.active_children())
        self.pool = ProcessPoolExecutor(self.width, self._context, _enter, (self.key, self.task))

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        with warnings.catch_warnings():
            # Python 3.12 warns when a library has threads; those of BLAS look after themselves at a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            return self.pool.submit(run_chunk, self.key, None, members)

    def renew(self) -> bool:
        self.stop(at_once=True)
        self._made()
        return True

    def stop(self, at_once: bool) -> None:
        if at_once:
            # A solver's loop is C: it is ended by nothing gentler.
            for child in set(multiprocessing.active_children()) - self._others:
                child.terminate()
        self.pool.shutdown(wait=not at_once, cancel_futures=True)


class Foreign:
    """An executor that somebody else has made: each worker is sent the model with each chunk, and unpacks it once."""

    def __init__(self, task: Task, executor: Executor, width: int) -> None:
        self.executor, self.flight = executor, _AHEAD * width
        self.packed = packed(task)
        self.key = f"{os.getpid()} {id(task)} {time.time_ns()}"

    def submit(self, members: Sequence[Member]) -> Future[list[Outcome]]:
        return self.executor.submit(run_chunk, self.key, self.packed, members)

    def renew(self) -> bool:
        return False

    def stop(self, at_once: bool) -> None:
        pass


def _enter(key: str, task: Task) -> None:
    """Begin as a worker: end with the parent, leave Ctrl-C to it, and say nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (for the life of the process)
    remember(key, task)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def packed(task: Task) -> bytes:
    """A task as bytes, with the file of a model that was named by its path.

    Functions without a name go along where `cloudpickle` is installed, which Dask brings.

    Raises UsageError: AC064 when something in the model cannot be sent.
    """
    return pickle.dumps((_files(task.component), _dumped(task)))


def _dumped(task: Task) -> bytes:
    try:
        return pickle.dumps(task)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        problem = str(error)
    try:  # takes functions that have no name, such as those of inputs
        from cloudpickle import dumps

        return bytes(dumps(task))
    except (ImportError, pickle.PicklingError, TypeError, AttributeError) as error:
        raise UsageError(
            "AC064",
            f"{task.model.name} cannot be sent to the workers of this executor",
            evidence=[problem, str(error)],
            help="put classes and functions into a module, at its top; or leave the executor out",
        ) from error


def _files(component: Component | None) -> list[tuple[str, str, str]]:
    """Name, path and text of the file of a model that nobody finds by its name: it was named by its path."""
    module = sys.modules.get(type(component).__module__)
    if component is None or module is None or module.__name__ == "__main__" or not module.__file__:
        return []
    if PathFinder.find_spec(module.__name__.partition(".")[0]) is not None:
        return []
    return [(module.__name__, module.__file__, Path(module.__file__).read_text(encoding="utf-8"))]


def carried_out(crew: Crew, task: Task, members: Sequence[Member], pace: float, keep: Keep) -> None:
    """Have all members run; `keep` is called with outcomes as they come, `pace` is an estimate of seconds a member.

    Raises RunError: AC413 when the workers are gone and are not ours to replace.
    Raises UsageError: AC064 when a worker cannot load the model.
    """
    waiting, suspects = deque(members), deque[Member]()
    running: dict[Future[list[Outcome]], Sequence[Member]] = {}
    spent, count = pace, 1
    heaviest = max(1, int(_BYTES / (8.0 * (1 + task.grid.size) * len(task.signals))))
    at_once = True
    try:
        while waiting or suspects or running:
            # one that may end its process runs alone
            if suspects:
                if not running:
                    chunk: Sequence[Member] = [suspects.popleft()]
                    running[_submitted(crew, chunk)] = chunk
            else:
                while waiting and len(running) < crew.flight:
                    fair = math.ceil(len(waiting) / crew.flight)
                    size = min(heaviest, fair, max(1, int(_CHUNK * count / max(spent, 1e-6))))
                    chunk = [waiting.popleft() for _ in range(min(size, len(waiting)))]
                    running[_submitted(crew, chunk)] = chunk
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk = running.pop(future)
                outcomes = _collected(crew, task, future, chunk, running, suspects)
                keep(outcomes)
                for outcome in outcomes:
                    if math.isfinite(outcome.seconds):
                        spent, count = spent + outcome.seconds, count + 1
                if suspects:
                    break
        at_once = False
    finally:
        for future in running:
            future.cancel()
        crew.stop(at_once)


def _submitted(crew: Crew, chunk: Sequence[Member]) -> Future[list[Outcome]]:
    try:
        return crew.submit(chunk)
    except BrokenExecutor as error:
        broken: Future[list[Outcome]] = Future()
        broken.set_exception(error)
        return broken


def _collected(
    crew: Crew,
    task: Task,
    future: Future[list[Outcome]],
    chunk: Sequence[Member],
    running: dict[Future[list[Outcome]], Sequence[Member]],
    suspects: deque[Member],
) -> list[Outcome]:
    """The outcomes of a chunk; of one whose worker was lost that of its only member, or none for now."""
    try:
        return future.result()
    except (BrokenExecutor, CancelledError) as error:
        together = [*chunk]
        for other in list(running):
            if not other.done() or other.cancelled() or other.exception() is not None:
                together += running.pop(other)
        if not crew.renew():
            raise RunError(
                "AC413",
                "the workers of the executor are gone",
                evidence=[f"{type(error).__name__}: {error}"],
                help="what was done before is kept where the sweep has a file: begin again with resume",
            ) from error
        if len(together) > 1:
            suspects.extend(together)
            return []
        return [failed(task, chunk[0][0], "AC412", "its process ended without a word: a crash, or no memory left")]
    except (ImportError, pickle.UnpicklingError) as error:
        raise UsageError(
            "AC064",
            f"the workers cannot load {task.model.name}",
            evidence=[f"{type(error).__name__}: {error}"],
            help="its modules, and the same versions of acausal and CasADi, have to be installed there; classes of a "
            "script belong into a file of their own",
        ) from error
    except Exception as error:
        if len(chunk) > 1:
            suspects.extend(chunk)
            return []
        return [failed(task, chunk[0][0], "AC412", f"its worker failed: {type(error).__name__}: {error}")]
