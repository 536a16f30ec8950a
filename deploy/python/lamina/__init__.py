"""Lamina from Python: hand over the time steps of a simulation, read what was recorded, watch what others write.

    run = lamina.Client("blast", "density", dims=(64, 64, 64), type="float32")    # a simulation's side; needs no NumPy
    step = lamina.read("out/vdi/blast/step_000012.vdi")                             # arrays and pictures
    lamina.view(step)                                                            # in a notebook: a picture that can be turned
    lamina.watch("folder/")                                                      # files as they appear, or a stream of steps
"""

from .client import POLICIES, TYPES, Client, Request, Summary

__all__ = ["POLICIES", "TYPES", "Client", "Reduced", "Request", "Run", "Summary", "Vdi", "Volume", "catalyst_path", "paraview_path", "read", "view", "watch"]

# What needs NumPy is loaded when it is first asked for.
_LATER = {"catalyst_path": "installed", "paraview_path": "installed", "Reduced": "reader", "Run": "reader", "Vdi": "reader", "Volume": "reader", "read": "reader", "view": "notebook", "watch": "follow"}


def __getattr__(name):
    if name not in _LATER:
        raise AttributeError(f"module 'lamina' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(f".{_LATER[name]}", __name__), name)


def __dir__():
    return __all__
