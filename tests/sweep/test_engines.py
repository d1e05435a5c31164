"""Engines make what they are given; runs here are calls, made by `operator.call` in whatever process."""

import functools
import math
import operator
import os
import signal
import sys
import time
from collections import Counter

import pytest

from eadp.errors import EadpError, InputError
from eadp.sweep.engines import QUEUED, TASK_S, DaskEngine, PoolEngine, SerialEngine, open_engine

DEATH = functools.partial(os._exit, 3)


def product(i):
    """A run whose result is i!; its process and the order do not matter."""
    return functools.partial(math.factorial, i)


def made(engine, runs):
    """Results by run, at most as many under way as the engine has room for."""
    results, waiting = {}, list(runs)
    while waiting or engine.busy:
        while waiting and engine.room > 0:
            engine.submit(waiting.pop())
        for run, result in engine.finished():
            assert (*run.args, run.func) not in results
            results[*run.args, run.func] = result
    return results


def expected(runs):
    return {(*run.args, run.func): run() for run in runs}


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


RUNS = [product(i) for i in range(30)]


def test_a_pool_makes_every_run_and_leaves_no_process():
    engine = PoolEngine(operator.call, 2)
    assert made(engine, RUNS) == expected(RUNS)
    pids = list(made(engine, [functools.partial(os.getpid)]).values())
    assert pids != [os.getpid()]
    engine.close()
    assert not any(map(alive, pids))


def test_a_run_that_kills_its_process_is_given_back_and_the_rest_is_made():
    engine = PoolEngine(operator.call, 2)
    runs = [*RUNS[:6], DEATH, *RUNS[6:]]
    results = made(engine, runs)
    engine.close()
    assert results == {**expected(RUNS), (3, os._exit): None}


def test_a_pool_closes_in_the_middle_of_a_run():
    engine = PoolEngine(operator.call, 1)
    ((pid,),) = [list(made(engine, [functools.partial(os.getpid)]).values())]
    engine.submit(functools.partial(signal.pause))  # a run without an end
    engine.close()
    assert not alive(pid)


def test_the_options_choose_the_engine(monkeypatch):
    assert isinstance(open_engine(operator.call, 9, 1), SerialEngine)
    assert isinstance(open_engine(operator.call, 1), SerialEngine)
    pool = open_engine(operator.call, 2, 9)
    assert isinstance(pool, PoolEngine)
    assert pool.workers == 2
    pool.close()
    monkeypatch.setattr(DaskEngine, "__init__", lambda engine, make, address: None)
    assert isinstance(open_engine(operator.call, 1, scheduler="tcp://host:1"), DaskEngine)


def test_no_scheduler_is_an_error_at_the_option(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(sys.modules[DaskEngine.__module__], "CLUSTER_WAIT_S", 0.2)
    with pytest.raises(InputError, match="--scheduler:1:1: error: no scheduler answers"):
        DaskEngine(operator.call, "tcp://127.0.0.1:1")


def local_cluster(workers, **keys):
    """A scheduler with workers on this machine, by default of this process."""
    keys = {"processes": False, "protocol": "tcp", "threads_per_worker": 1, **keys}
    return pytest.importorskip("distributed").LocalCluster(
        n_workers=workers, host="127.0.0.1", dashboard_address="127.0.0.1:0", memory_limit=0, **keys
    )


@pytest.fixture(scope="module")
def scheduler():
    """The address of a scheduler with two workers on this machine."""
    # a local cluster gives up a worker that a loaded machine does not start again within 15 s
    with (
        pytest.importorskip("dask").config.set({"distributed.deploy.lost-worker-timeout": "600 s"}),
        local_cluster(2, processes=True) as cluster,
    ):
        yield cluster.scheduler_address


def test_a_cluster():
    with local_cluster(2) as cluster:
        engine = DaskEngine(operator.call, cluster.scheduler_address)
        assert engine.workers == 2
        assert made(engine, RUNS) == expected(RUNS)
        engine.close()


def test_a_scheduler_without_workers_is_an_error_in_the_end(monkeypatch):
    module = sys.modules[DaskEngine.__module__]
    monkeypatch.setattr(module, "ALONE_S", 0.2)
    monkeypatch.setattr(module, "WORKERS_S", 0.1)
    with local_cluster(0) as cluster:
        engine = DaskEngine(operator.call, cluster.scheduler_address)
        engine.submit(RUNS[0])
        with pytest.raises(EadpError, match=r"has had no workers for 0.2 s; the results so far are kept: start"):
            engine.finished()
        engine.close()


@pytest.mark.slow
def test_short_runs_share_a_task_and_a_long_one_has_its_own(scheduler):
    engine = DaskEngine(operator.call, scheduler)
    assert engine.room == 2 * QUEUED
    assert made(engine, RUNS) == expected(RUNS)
    assert engine.room > 2 * QUEUED
    made(engine, [functools.partial(time.sleep, 2 * TASK_S)])
    assert engine.room == 2 * QUEUED
    engine.close()


@pytest.mark.slow
def test_a_worker_that_cannot_make_runs_is_an_error(scheduler):
    engine = DaskEngine(operator.neg, scheduler)
    engine.submit(RUNS[0])
    with pytest.raises(EadpError, match="makes no runs: TypeError: bad operand"):
        engine.finished()
    engine.close()


@pytest.mark.slow
def test_a_run_that_kills_its_workers_is_given_back_and_the_rest_is_made(scheduler):
    engine = DaskEngine(operator.call, scheduler)
    assert made(engine, [*RUNS[:3], DEATH, *RUNS[3:]]) == {**expected(RUNS), (3, os._exit): None}
    engine.close()


@pytest.mark.slow
def test_runs_of_many_a_task_outlive_their_worker(scheduler):
    from distributed import Client

    engine, runs = DaskEngine(operator.call, scheduler), [product(i % 30) for i in range(20_000)]
    results, waiting, tasks = [], list(runs), 0
    send = engine._send

    def counted(task):
        nonlocal tasks
        tasks += 1
        return send(task)

    engine._send = counted
    with Client(scheduler, set_as_default=False) as client:
        victim = next(iter(client.run(os.getpid).values()))
        while waiting or engine.busy:
            while waiting and engine.room > 0:
                engine.submit(waiting.pop())
            results += engine.finished()
            if victim and len(results) > 1000:
                os.kill(victim, signal.SIGKILL)
                victim = None
    engine.close()
    assert victim is None
    assert Counter(run.args for run, _ in results) == Counter(run.args for run in runs)
    assert all(result == run() for run, result in results)
    assert tasks < 200
