"""Logs of autopilots and bags, read in the tests' own process."""

import contextlib
import importlib
import io
import subprocess
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from eadp.measure import autopilot_logs


@pytest.fixture(autouse=True)
def in_process(monkeypatch):
    """Logs are read in this process, which takes a tenth of the time, where the process is not the subject."""
    one, opened = importlib.import_module("eadp.measure.autopilot_process"), []

    def kept_open(*given):
        opened.append(open(*given))  # noqa: SIM115
        return opened[-1]

    def run(command, **_):
        form, path, topics = *command[-3:-1], command[-1].split(",")
        out = io.BytesIO()
        try:
            with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
                own = {"ulog": one._ulog, "bag": one._bag}.get(form)
                np.savez(out, **(own(path, topics) if own else one._dataflash(form, path, topics)))
        except Exception as error:
            return SimpleNamespace(returncode=1, stderr=f"{type(error).__name__}: {error}".encode())
        finally:
            for file in opened:
                file.close()
        return SimpleNamespace(returncode=0, stdout=out.getvalue())

    monkeypatch.setattr(autopilot_logs, "subprocess", SimpleNamespace(run=run, DEVNULL=subprocess.DEVNULL))
    with contextlib.suppress(ImportError):  # it leaves its file to the collector
        monkeypatch.setattr("pymavlink.DFReader.open", kept_open, raising=False)


@pytest.fixture
def process(in_process, monkeypatch):
    """The process that has limits."""
    monkeypatch.undo()
