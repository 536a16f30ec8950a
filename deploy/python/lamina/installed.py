"""Where the native libraries and programs of the package are."""

import ctypes
import os
import sys
from pathlib import Path

# A wheel brings them here.
INSTALLED = Path(__file__).parent / "native"


def load(name, variable, newest):
    """The library `name`: at the path in the environment variable `variable`, or as installed, or where the system looks for it. `newest` is
    the function that came to it last: a library without it is older than this package."""
    file = {"darwin": f"lib{name}.dylib", "win32": f"{name}.dll"}.get(sys.platform, f"lib{name}.so")
    installed = INSTALLED / file
    try:
        library = ctypes.CDLL(os.environ.get(variable) or (str(installed) if installed.exists() else file))
    except OSError as error:
        raise OSError(f"{error}; name the library in {variable}, such as target/release/{file}") from None
    if not hasattr(library, newest):
        raise OSError(f"{library._name} is older than this package: it has no {newest}; build it anew, or name another in {variable}")
    return library


def program(name):
    """Path of the program `name`: as installed, in the folder LAMINA_BIN, or as the shell finds it."""
    folder = os.environ.get("LAMINA_BIN")
    if folder:
        return os.path.join(folder, name)
    installed = INSTALLED / name
    return str(installed) if installed.exists() else name


def catalyst_path():
    """Folder of the implementation of Catalyst, for CATALYST_IMPLEMENTATION_PATHS."""
    return str(INSTALLED)


def paraview_path():
    """File of ParaView's reader of recorded steps, for Tools > Manage Plugins."""
    return str(Path(__file__).with_name("paraview_plugin.py"))
