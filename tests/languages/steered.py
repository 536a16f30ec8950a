"""Says what people ask for, until they ask for the end: steered.py URL."""

import array
import sys
import time

import lamina

values = memoryview(array.array("f", bytes(4 * 8**3))).cast("B").cast("f", (8, 8, 8))
numbers = {"inflow": (1, 0, 2), "angle": (0, -90, 90)}
with lamina.Client("steered", "f", (8, 8, 8), "float32", generator=sys.argv[1], steering=numbers) as run:
    paused = False
    for step in range(6000):
        if not paused:
            run.push(step, 0.0, values)
        time.sleep(0.01)
        for request in run.steering():
            print(f"{request.name} = {request.value:.2f}" if request.what == "set" else request.what)
            paused = {"pause": True, "set": paused}.get(request.what, False)
            if request.what == "stop":
                sys.exit()
sys.exit("nobody asked for the end")
