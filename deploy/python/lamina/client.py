"""What a simulation in Python imports to hand its time steps to a Lamina generator-node.

    run = lamina.Client("blast", "density", dims=(64, 64, 64), type="float32")
    for step in range(steps):
        ...
        run.push(step, time, density)
    run.close()

Arrays are anything with the buffer protocol, NumPy's among them, with axes in the order x, y, z; whatever their strides
(ghost cells, transposed views), they are read where they are, not copied. Connect after forking, not before.
"""

import collections
import contextlib
import ctypes
import os
import sys
import threading

from .installed import load

TYPES = {"uint8": 1, "uint16": 2, "int16": 3, "float16": 4, "float32": 5, "float64": 6}
POLICIES = {"drop oldest": 0, "drop newest": 1, "block": 2}
# Letters of the buffer protocol.
_FORMATS = {"B": "uint8", "H": "uint16", "h": "int16", "e": "float16", "f": "float32", "d": "float64"}
# What people who watch ask for.
_REQUESTS = {1: "pause", 2: "resume", 3: "stop", 4: "set"}
_ERRORS = {-1: ValueError, -3: ConnectionError, -4: TimeoutError}


class _Options(ctypes.Structure):
    _fields_ = [
        ("generator", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("field", ctypes.c_char_p),
        ("dims", ctypes.c_uint64 * 3),
        ("spacing", ctypes.c_double * 3),
        ("origin", ctypes.c_double * 3),
        ("type", ctypes.c_int32),
        ("color_type", ctypes.c_int32),
        ("color_field", ctypes.c_char_p),
        ("rank", ctypes.c_uint32),
        ("ranks", ctypes.c_uint32),
        ("full_policy", ctypes.c_int32),
        ("deadline_secs", ctypes.c_double),
        ("credentials", ctypes.c_char_p),
        ("steering", ctypes.c_int32),
        ("number_count", ctypes.c_uint32),
        ("numbers", ctypes.c_void_p),
        ("more_fields", ctypes.c_void_p),
        ("more_field_count", ctypes.c_uint32),
        ("shown", ctypes.c_char_p),
        ("coordinates", ctypes.c_void_p * 3),
    ]


class _Field(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("type", ctypes.c_int32)]


class _Array(ctypes.Structure):
    _fields_ = [("voxels", ctypes.c_void_p), ("type", ctypes.c_int32)]


class _Number(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("value", ctypes.c_double),
        ("least", ctypes.c_double),
        ("most", ctypes.c_double),
    ]


class _Request(ctypes.Structure):
    _fields_ = [
        ("what", ctypes.c_int32),
        ("number", ctypes.c_int32),
        ("value", ctypes.c_double),
        ("asked_by", ctypes.c_char * 64),
    ]


# `what`: "pause", "resume", "stop" or "set"; name and value are of "set", else None.
Request = collections.namedtuple("Request", "what name value asked_by")


class _Brick(ctypes.Structure):
    _fields_ = [
        ("start", ctypes.c_uint64 * 3),
        ("dims", ctypes.c_uint64 * 3),
        ("strides", ctypes.c_uint64 * 3),
        ("voxels", ctypes.c_void_p),
        ("colors", ctypes.c_void_p),
        ("type", ctypes.c_int32),
        ("color_type", ctypes.c_int32),
        ("more", ctypes.c_void_p),
    ]


class Summary(ctypes.Structure):
    """What became of a run's bricks; run_dropped_steps is -1 if the node did not answer."""

    _fields_ = [
        ("pushed", ctypes.c_uint64),
        ("dropped", ctypes.c_uint64),
        ("lost", ctypes.c_uint64),
        ("run_dropped_steps", ctypes.c_int64),
    ]

    def __repr__(self):
        return f"Summary({', '.join(f'{name}={getattr(self, name)}' for name, _ in self._fields_)})"


class _Buffer(ctypes.Structure):
    """Py_buffer of the buffer protocol."""

    _fields_ = [
        ("buf", ctypes.c_void_p),
        ("obj", ctypes.py_object),
        ("len", ctypes.c_ssize_t),
        ("itemsize", ctypes.c_ssize_t),
        ("readonly", ctypes.c_int),
        ("ndim", ctypes.c_int),
        ("format", ctypes.c_char_p),
        ("shape", ctypes.POINTER(ctypes.c_ssize_t)),
        ("strides", ctypes.POINTER(ctypes.c_ssize_t)),
        ("suboffsets", ctypes.POINTER(ctypes.c_ssize_t)),
        ("internal", ctypes.c_void_p),
    ]


class _View:
    """Where an array lies in memory, held there for a `with` block."""

    STRIDED_WITH_FORMAT = 0x0010 | 0x0008 | 0x0004

    def __init__(self, array):
        self.array, self.buffer = array, _Buffer()

    def __enter__(self):
        get = ctypes.pythonapi.PyObject_GetBuffer
        get.argtypes = [ctypes.py_object, ctypes.POINTER(_Buffer), ctypes.c_int]
        get(self.array, ctypes.byref(self.buffer), self.STRIDED_WITH_FORMAT)
        try:
            b = self.buffer
            letters = (b.format or b"B").decode().lstrip("@=" + ("<" if sys.byteorder == "little" else ">"))
            if b.ndim != 3 or letters not in _FORMATS:
                raise ValueError(f"{b.ndim} axes of '{letters}'; three are needed, of {', '.join(TYPES)}")
            self.type = TYPES[_FORMATS[letters]]
            self.dims = list(b.shape[:3])
            # Of an axis of one there is no next.
            strides = [b.itemsize if n == 1 else s for n, s in zip(self.dims, b.strides[:3])]
            if any(s <= 0 or s % b.itemsize for s in strides):
                raise ValueError(f"strides of {strides} bytes; positive multiples of {b.itemsize} are needed")
            self.strides = [s // b.itemsize for s in strides]
        except ValueError:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        ctypes.pythonapi.PyBuffer_Release(ctypes.byref(self.buffer))


def _brick(views, names, voxels, start, colors=None, more=None):
    """Where a brick lies in memory, held there by `views`; `names` are those of the run's further fields."""
    v = views.enter_context(_View(voxels))
    brick = _Brick(_three(ctypes.c_uint64, "start", start))
    brick.dims, brick.strides = _three(ctypes.c_uint64, "dims", v.dims), _three(ctypes.c_uint64, "strides", v.strides)
    brick.voxels, brick.type = v.buffer.buf, v.type

    def beside(thing, array):
        a = views.enter_context(_View(array))
        if (a.dims, a.strides) != (v.dims, v.strides):
            raise ValueError(f"{thing} are to be laid out in memory as voxels are")
        return a.buffer.buf, a.type

    if colors is not None:
        brick.colors, brick.color_type = beside("colors", colors)
    more = more or {}
    if set(more) != set(names):
        raise ValueError(f"arrays of {sorted(more)}; the run's more_fields are {names}")
    if names:
        arrays = (_Array * len(names))(*(beside(name, more[name]) for name in names))
        views.callback(lambda _: None, arrays)
        brick.more = ctypes.addressof(arrays)
    return brick


def _positions(axis, positions, size):
    """As many numbers as the axis has sample points; None if it is even."""
    if positions is None:
        return None
    if len(positions) != size:
        raise ValueError(f"coordinates: {len(positions)} positions along {axis}; dims say {size} sample points")
    return (ctypes.c_double * size)(*positions)


def _three(kind, thing, values):
    values = list(values)
    if len(values) != 3:
        raise ValueError(f"{thing}: {len(values)} numbers; three are needed, for x, y, z")
    return (kind * 3)(*values)


def _known(table, name):
    if name not in table:
        raise ValueError(f"{name} is none of {', '.join(table)}")
    return table[name]


def _library():
    library = load("lamina_c", "LAMINA_LIBRARY", "lamina_diagnostic")
    library.lamina_connect_sized.argtypes = [
        ctypes.POINTER(_Options),
        ctypes.c_size_t,
        ctypes.POINTER(ctypes.c_void_p),
    ]
    library.lamina_diagnostic.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double]
    library.lamina_wants.argtypes = [ctypes.c_void_p, ctypes.c_uint64]
    library.lamina_push.argtypes = [ctypes.c_void_p, ctypes.c_uint64, ctypes.c_double, ctypes.POINTER(_Brick)]
    library.lamina_push_bricks.argtypes = [
        ctypes.c_void_p,
        ctypes.c_uint64,
        ctypes.c_double,
        ctypes.POINTER(_Brick),
        ctypes.c_size_t,
    ]
    library.lamina_buffer.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(ctypes.c_uint64),
        ctypes.POINTER(ctypes.c_void_p),
        ctypes.POINTER(ctypes.c_void_p),
        ctypes.POINTER(ctypes.c_void_p),
    ]
    library.lamina_steering.argtypes = [ctypes.c_void_p, ctypes.POINTER(_Request)]
    library.lamina_close.argtypes = [ctypes.c_void_p, ctypes.POINTER(Summary)]
    library.lamina_close.restype = None
    library.lamina_error.restype = ctypes.c_char_p
    return library


class Client:
    """A connection to a generator-node. ValueError if the run cannot be right, OSError if the node refuses it; the
    simulation may go on without."""

    def __init__(
        self,
        name,
        field,
        dims,
        type,
        generator="http://127.0.0.1:7101",
        spacing=(1.0, 1.0, 1.0),
        origin=(0.0, 0.0, 0.0),
        color_field=None,
        color_type=None,
        rank=None,
        ranks=None,
        comm=None,
        full_policy="drop oldest",
        deadline_secs=5.0,
        credentials=None,
        steering=None,
        more_fields=None,
        shown=None,
        coordinates=None,
    ):
        """Rank and ranks: as stated, those of `comm` (mpi4py), or as the MPI launcher's environment says; else one. `credentials`:
        folder of keys for a node at https://, else as LAMINA_CREDENTIALS says. `steering`: numbers that people who watch may change,
        {"name": (value, least, most)}, or {} for none; requests are then given by steering(). `more_fields`: {"name": type} of
        fields that every push carries, too, of which people who watch may choose; `v.x`, `v.y`, `v.z` are together the vector `v`.
        `shown`: what is shown first, a field or an expression such as "magnitude(v)"; else `field`. `coordinates`: (x, y, z), positions of
        the sample points along each axis where they are not even, ascending, None for an axis that is; steps are shown on as many even
        ones."""
        if comm is not None:
            rank, ranks = comm.Get_rank(), comm.Get_size()
        self._library, self._lock, self._summary = _library(), threading.Lock(), None
        type_name = lambda of: getattr(of, "__name__", str(of))
        more_fields = {name: type_name(of) for name, of in (more_fields or {}).items()}
        self._types = [type_name(type)] + ([type_name(color_type)] if color_type else []) + list(more_fields.values())
        self._more, self._colored = list(more_fields), bool(color_type)
        fields = [_Field(name.encode(), _known(TYPES, of)) for name, of in more_fields.items()]
        fields = (_Field * len(fields))(*fields)
        options = _Options(
            generator.encode(),
            name.encode(),
            field.encode(),
            _three(ctypes.c_uint64, "dims", dims),
            _three(ctypes.c_double, "spacing", spacing),
            _three(ctypes.c_double, "origin", origin),
            _known(TYPES, type_name(type)),
            _known(TYPES, type_name(color_type)) if color_type else 0,
            color_field.encode() if color_field else None,
            rank or 0,
            ranks or 0 if rank is None else ranks or 1,
            _known(POLICIES, full_policy),
            deadline_secs,
            os.fsencode(credentials) if credentials else None,
            steering is not None,
        )
        self._numbers = list(steering or {})
        numbers = [_Number(name.encode(), *map(float, of)) for name, of in (steering or {}).items()]
        numbers = (_Number * len(numbers))(*numbers)
        options.number_count, options.numbers = len(numbers), ctypes.addressof(numbers)
        options.more_field_count, options.more_fields = len(fields), ctypes.addressof(fields)
        options.shown = shown.encode() if shown else None
        axes = [_positions(name, of, size) for name, of, size in zip("xyz", coordinates or (None, None, None), dims)]
        options.coordinates = (ctypes.c_void_p * 3)(*(axis and ctypes.addressof(axis) for axis in axes))
        self._client = ctypes.c_void_p()
        size = ctypes.sizeof(options)
        self._check(self._library.lamina_connect_sized(ctypes.byref(options), size, ctypes.byref(self._client)))

    def wants(self, step):
        """Whether to compute and push `step`: to be asked where its values cost something to have, once a step; what is done between
        this and the push counts as a cost of watching. False if the node goes without it, because a contract limits that cost
        ("overhead <= 5%"): it counts as one brick dropped, and is not to be pushed. Errors are those of push: the step is lost,
        and is not to be pushed either. Ranks need not get the same answer: where all have a part in computing the values, let them
        wait for each other first, then ask, then agree."""
        with self._lock:
            return self._check(self._library.lamina_wants(self._client, step)) == 1

    def diagnostic(self, name, value):
        """Tells a number of the step that is pushed next, such as a residual or an energy: it is shown and recorded beside the field,
        and triggers and alerts can depend on it. `name`: 1 to 60 letters, digits and _, a letter first; a step has at most 64."""
        with self._lock:
            self._check(self._library.lamina_diagnostic(self._client, str(name).encode(), value))

    def push(self, step, time, voxels, start=(0, 0, 0), colors=None, more=None):
        """Hands in this rank's part of a step, which begins at index `start` of the run's grid; `more` has the arrays of the run's
        more_fields by their names, laid out in memory as `voxels` are. False if the node is full and dropped the step, as the
        run's policy says. ValueError for what does not fit the run; OSError where the node refuses it, ConnectionError or
        TimeoutError where it cannot be reached: the step is lost, and the simulation may go on."""
        with contextlib.ExitStack() as views:
            brick = _brick(views, self._more, voxels, start, colors, more)
            with self._lock:
                return self._check(self._library.lamina_push(self._client, step, time, ctypes.byref(brick))) == 0

    def push_bricks(self, step, time, bricks):
        """The same of several bricks, or of none: pairs of `start` and an array, or more with the colors (or None) and `more`."""
        with contextlib.ExitStack() as views:
            several = [_brick(views, self._more, voxels, start, *others) for start, voxels, *others in bricks]
            several = (_Brick * len(several))(*several)
            with self._lock:
                pushed = self._library.lamina_push_bricks(self._client, step, time, several, len(several))
                return self._check(pushed) == 0

    def buffer(self, dims):
        """A NumPy array of shape `dims`, axes x, y, z, to compute into, or, of a run with several fields, one for each: a node on
        the same host reads them where they are. Each is for one push, and not to be used after it."""
        import numpy

        voxels, colors, more = ctypes.c_void_p(), ctypes.c_void_p(), (ctypes.c_void_p * len(self._more))()
        with self._lock:
            places = [ctypes.byref(voxels), ctypes.byref(colors), more]
            self._check(self._library.lamina_buffer(self._client, _three(ctypes.c_uint64, "dims", dims), *places))
        arrays = []
        addresses = [voxels.value] + ([colors.value] if self._colored else []) + list(more)
        for address, type_name in zip(addresses, self._types):
            dtype = numpy.dtype(type_name)
            size = int(numpy.prod(dims, dtype=numpy.int64)) * dtype.itemsize
            memory = (ctypes.c_char * size).from_address(address)
            arrays.append(numpy.frombuffer(memory, dtype).reshape(dims, order="F"))
        return arrays[0] if len(arrays) == 1 else tuple(arrays)

    def steering(self):
        """What people who watch have asked for since this was called last, oldest first; at once. Call it between steps. What of it
        is done is the simulation's choice. A pause whose node is lost is ended by a "resume"."""
        requests, request = [], _Request()
        with self._lock:
            while self._check(self._library.lamina_steering(self._client, ctypes.byref(request))) > 0:
                what, of_number = _REQUESTS[request.what], request.what == 4
                name, value = (self._numbers[request.number], request.value) if of_number else (None, None)
                requests.append(Request(what, name, value, request.asked_by.decode()))
        return requests

    def _check(self, code):
        if code < 0:
            raise _ERRORS.get(code, OSError)(self._library.lamina_error().decode())
        return code

    def close(self):
        """Ends this rank's part of the run; what became of its bricks."""
        with self._lock:
            if self._summary is None:
                self._summary = Summary(0, 0, 0, -1)
                self._library.lamina_close(self._client, ctypes.byref(self._summary))
                self._client = None
            return self._summary

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
