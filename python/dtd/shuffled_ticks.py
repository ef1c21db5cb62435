"""The ticks of a corpus in a shuffled order that decodes each image once.

    from torch.utils.data import DataLoader

    from dtd import Corpus
    from dtd.shuffled_ticks import ShuffledTicks
    from dtd.tick_dataset import TickDataset

    if __name__ == "__main__":  # for workers that are spawned
        train = ShuffledTicks(TickDataset(Corpus("corpus"), side="train", crop_px=(96, 64)), seed=1)
        for epoch in range(10):
            train.set_epoch(epoch)
            for batch in DataLoader(train, batch_size=32, num_workers=2):
                ...

A sample at random costs the decoding of all images since the key frame before it. Here scenarios are cut into runs of consecutive ticks,
the order of the runs is shuffled, and samples are taken from several runs at a time, one of each in a random order. The samples of a batch
come from different scenarios, as far as the corpus has them; those of one run keep their order. Threads decode some samples of each run
ahead.
"""

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from dtd.tick_dataset import Run, Sample, TickDataset
from dtd.video import Video

if TYPE_CHECKING:
    _IterableDataset = object

    def get_worker_info() -> Any: ...

    def _shared_number() -> Any: ...
else:
    try:
        import torch
        from torch.utils.data import IterableDataset as _IterableDataset
        from torch.utils.data import get_worker_info

        def _shared_number() -> Any:
            """A number that workers of a `DataLoader` see change, also those that live for several epochs."""
            return torch.zeros(1, dtype=torch.int64).share_memory_()
    except ImportError:
        _IterableDataset = object

        def get_worker_info() -> None:
            """Without torch there are no workers."""

        def _shared_number() -> Any:
            """A number."""
            return [0]

RUN_TICKS = 240
"""Length of a run. A multiple of the distance of key frames in a corpus (60), so that no image is decoded for nothing."""

MAX_AHEAD = 8
"""Most samples of a run that are decoded ahead: a decoder that goes on for some images finds its own in the processor's caches."""
AHEAD_BYTES = 64 << 20
"""Most memory for the images that are decoded ahead, in each worker. Where it is too small, samples are decoded when they are asked for."""


class ShuffledTicks(_IterableDataset):
    """The samples of a `TickDataset`, each once, in a shuffled order. With torch, a `torch.utils.data.IterableDataset`."""

    def __init__(self, ticks: TickDataset, *, seed: int = 0, runs_at_once: int = 16) -> None:
        """`runs_at_once`: from how many runs samples are taken in turn, in each worker; each has a decoder per view."""
        if runs_at_once < 1:
            raise ValueError(f"runs_at_once={runs_at_once} must be 1 or more")
        self._of_ticks = ticks
        self._seed = seed
        self._epoch = _shared_number()
        self._runs_at_once = runs_at_once

    def set_epoch(self, epoch: int) -> None:
        """Chooses the order of the next iteration: seed and epoch determine it. Without a new epoch it is the same again."""
        self._epoch[0] = epoch

    def __len__(self) -> int:
        """Number of samples of an epoch. Each worker of a `DataLoader` ends with a batch of its own, so more batches may come than it counts."""
        return len(self._of_ticks)

    def __iter__(self) -> Iterator[Any]:
        """The samples; in a worker of a `DataLoader`, its share of the runs."""
        worker, workers = _worker()
        runs = self._shuffled_runs()[worker::workers]
        random = np.random.default_rng([self._seed, int(self._epoch[0]), worker, 1])
        open_runs: list[_OpenRun] = []
        ahead = min(AHEAD_BYTES // (self._runs_at_once * self._of_ticks.sample_bytes), MAX_AHEAD)
        threads = ThreadPoolExecutor(max(_cores() // workers, 1)) if ahead > 1 else None
        try:
            while runs or open_runs:
                while runs and len(open_runs) < self._runs_at_once:
                    open_scenarios = {run.scenario for run in open_runs}
                    others = (at for at, run in enumerate(runs) if run.scenario not in open_scenarios)
                    run = runs.pop(next(others, 0))
                    open_runs.append(_OpenRun(self._of_ticks, run, threads, ahead // 2))
                for place in random.permutation(len(open_runs)):
                    yield self._of_ticks.transformed(open_runs[place].next_sample())
                for ended in [run for run in open_runs if run.has_ended()]:
                    ended.close()
                    open_runs.remove(ended)
        finally:
            if threads is not None:
                threads.shutdown(cancel_futures=True)
            for left in open_runs:
                left.close()

    def _shuffled_runs(self) -> list[Run]:
        runs = self._of_ticks.runs(RUN_TICKS)
        order = np.random.default_rng([self._seed, int(self._epoch[0])]).permutation(len(runs))
        return [runs[at] for at in order]


class _OpenRun:
    """A run, and the videos that it is read from."""

    def __init__(self, ticks: TickDataset, run: Run, threads: Executor | None, at_once: int) -> None:
        """`threads` decode so many samples at once, while as many wait to be taken; without threads, each is decoded when it is taken."""
        self.scenario = run.scenario
        self._ticks = ticks
        self._left = deque(run.samples)
        self._threads = threads
        self._at_once = at_once
        self._decoded: deque[Sample] = deque()
        self._coming: Future[list[Sample]] | None = None
        self._videos: dict[str, Video] = {}
        self._process = os.getpid()
        self._ask()

    def next_sample(self) -> Sample:
        if self._process != os.getpid():
            raise RuntimeError("this iteration was started before the process was forked; its threads run only in the parent: iterate again here")
        if self._threads is None:
            return self._sample(self._left.popleft())
        if not self._decoded:
            assert self._coming is not None
            self._decoded.extend(self._coming.result())
            self._ask()
        return self._decoded.popleft()

    def _ask(self) -> None:
        """Has the next samples decoded."""
        if self._threads is None:
            return
        following = [self._left.popleft() for _ in range(min(self._at_once, len(self._left)))]
        self._coming = self._threads.submit(lambda: [self._sample(index) for index in following]) if following else None

    def _sample(self, index: int) -> Sample:
        return self._ticks.sample(index, self._video)

    def _video(self, scenario: str, view: str) -> Video:
        if view not in self._videos:
            # Threads of a decoder only cost where runs are decoded side by side.
            self._videos[view] = self._ticks.open_video(scenario, view, is_threaded=self._threads is None)
        return self._videos[view]

    def has_ended(self) -> bool:
        return not (self._left or self._decoded or self._coming)

    def close(self) -> None:
        """Closes the videos, once no thread decodes them."""
        for video in self._videos.values():
            video.close()
        self._videos.clear()


def _cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _worker() -> tuple[int, int]:
    """Number of this worker of a `DataLoader`, and how many there are."""
    info = get_worker_info()
    return (info.id, info.num_workers) if info is not None else (0, 1)
