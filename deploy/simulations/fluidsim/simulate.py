"""Decay of a Taylor-Green vortex with fluidsim, watched while it runs: simulate.py [POINTS] [END] [SAVED.npy]."""

import os
import sys
import time

import numpy as np
from fluidsim.solvers.ns3d.solver import Simul

# --- what watching it takes -----------------------------------------------------------------------------------------------
import lamina


def axes(array):
    """The same memory with its axes in the order x, y, z: fluidsim's is z, y, x."""
    return array.transpose()


def watch(sim):
    """A run of the velocity, of which Q, where vortices are, is shown; None without a node."""
    oper = sim.oper
    try:
        return lamina.Client(
            "taylor-green",
            "v.x",
            (oper.nx, oper.ny, oper.nz),
            "float64",
            generator=os.environ.get("LAMINA_GENERATOR", "http://127.0.0.1:7101"),
            spacing=(oper.deltax, oper.deltay, oper.deltaz),
            more_fields={"v.y": "float64", "v.z": "float64"},
            shown="q_criterion(v)",
        )
    except OSError as error:
        print(f"not shown: {error}", file=sys.stderr)


def push(run, sim, step):
    vx, vy, vz = (axes(sim.state.get_var(name)) for name in ("vx", "vy", "vz"))
    try:
        run and run.push(step, sim.time_stepping.t, vx, more={"v.y": vy, "v.z": vz})
    except OSError as lost:
        print(f"step {step} not shown: {lost}", file=sys.stderr)


# ---------------------------------------------------------------------------------------------------------------------------

points = int(sys.argv[1]) if len(sys.argv) > 1 else 64
params = Simul.create_default_params()
params.oper.nx = params.oper.ny = params.oper.nz = points
params.oper.Lx = params.oper.Ly = params.oper.Lz = 2 * np.pi
params.oper.type_fft = "fft3d.with_pyfftw"
params.nu_2 = 1 / 400
params.init_fields.type = "in_script"
params.time_stepping.t_end = float(sys.argv[2]) if len(sys.argv) > 2 else 10
params.output.HAS_TO_SAVE = False
sim = Simul(params)
x, y, z = sim.oper.get_XYZ_loc()
sim.state.init_statephys_from(
    vx=np.sin(x) * np.cos(y) * np.cos(z), vy=-np.cos(x) * np.sin(y) * np.cos(z), vz=np.zeros_like(x)
)
sim.state.statespect_from_statephys()

run = None if os.environ.get("ALONE") else watch(sim)
stepping = sim.time_stepping
stepping.prepare_main_loop()
begun, step = time.perf_counter(), 0
push(run, sim, step)
while stepping.t < stepping.params.time_stepping.t_end:
    stepping.one_time_step()
    step += 1
    if step % 2 == 0 or stepping.t >= stepping.params.time_stepping.t_end:
        push(run, sim, step)
print(f"seconds {time.perf_counter() - begun:.2f}, {step} steps")
if len(sys.argv) > 3:
    np.save(sys.argv[3], [axes(sim.state.get_var(name)) for name in ("vx", "vy", "vz")])
if run:
    ended = run.close()
    print(f"pushed {ended.pushed}, dropped {ended.dropped}, lost {ended.lost}")
