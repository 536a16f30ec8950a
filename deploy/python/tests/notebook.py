"""A run in a real JupyterLab and a real browser: notebook.py LAMINA_RUN. The widget is turned and its slider moved there, and Python knows.

Needs jupyterlab in this environment, chromium and chromedriver."""

import base64
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

CANVAS = "document.querySelector('.jp-OutputArea canvas[aria-label]')"
STATUS = "document.querySelector('.jp-OutputArea [role=status]').textContent"
ENTER, RIGHT, SHIFT = "\ue007", "\ue014", "\ue008"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def ask(url, body=None, method=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=120) as answer:
        return json.load(answer)


def wait(condition, what, seconds=300):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            if found := condition():
                return found
        except OSError:
            pass
        time.sleep(0.2)
    raise AssertionError(f"waited in vain for {what}")


class Browser:
    def __init__(self, profile):
        port = free_port()
        self.driver = subprocess.Popen(["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        base = f"http://127.0.0.1:{port}"
        wait(lambda: ask(f"{base}/status")["value"]["ready"], "chromedriver")
        arguments = ["--headless", "--no-sandbox", "--no-first-run", "--window-size=1100,1000", f"--user-data-dir={profile}"]
        asked = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": {"args": arguments}}}}
        self.session = f"{base}/session/{ask(f'{base}/session', asked)['value']['sessionId']}"

    def js(self, expression):
        return ask(f"{self.session}/execute/sync", {"script": f"return {expression}", "args": []})["value"]

    def wait(self, expression):
        try:
            return wait(lambda: self.js(expression), expression)
        except AssertionError as error:
            try:
                shown = self.js("(document.querySelector('.jp-Notebook') ?? document.body).innerText")
            except OSError as no_answer:
                shown = f"nothing: {no_answer}"
            error.add_note(f"the notebook reads: {shown}")
            raise

    def key(self, *keys):
        actions = [{"type": "keyDown", "value": key} for key in keys] + [{"type": "keyUp", "value": key} for key in reversed(keys)]
        ask(f"{self.session}/actions", {"actions": [{"type": "key", "id": "keys", "actions": actions}]})

    def run_cell(self, number):
        """Presses the keys until they are heard: while JupyterLab loads, it moves the focus."""
        cell = f"document.querySelectorAll('.jp-CodeCell')[{number}]"

        def heard():
            self.js(f"{cell}.querySelector('.cm-content').focus()")
            self.key(SHIFT, ENTER)
            time.sleep(2)
            return self.js(f"{cell}.querySelector('.jp-InputPrompt').textContent") not in ("", "[ ]:")

        wait(heard, f"cell {number} to run")

    def picture(self):
        return base64.b64decode(ask(f"{self.session}/screenshot")["value"])

    def close(self):
        ask(self.session, method="DELETE")
        self.driver.terminate()
        self.driver.wait()


def cell(name, *lines):
    return {"cell_type": "code", "execution_count": None, "id": name, "metadata": {}, "outputs": [], "source": "\n".join(lines)}


def main(run, screenshots):
    steps = sorted(int(file.stem.removeprefix("step_")) for file in run.glob("step_*.vdi"))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        shown = cell("shown", "import lamina", f"view = lamina.view({str(run)!r}, size=360)", "view")
        said = cell("said", "print('step', view.widget.step, 'azimuth', view.widget.pose['azimuth'])")
        back = cell("back", f"view.widget.step = {steps[-1]}", "view.widget.pose = {'azimuth': -60}")
        kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
        notebook = {"cells": [shown, said, back], "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
        (Path(folder) / "run.ipynb").write_text(json.dumps(notebook))
        port = free_port()
        options = ["--no-browser", "--allow-root", f"--port={port}", "--ServerApp.token=", "--ServerApp.password=", f"--notebook-dir={folder}"]
        # Settings and kernels of whoever runs this are left alone.
        own = {name: f"{folder}/{name.lower()}" for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR")}
        with open(Path(folder) / "jupyter.log", "w") as log:
            jupyter = subprocess.Popen([sys.executable, "-m", "jupyterlab", *options], stdout=log, stderr=log, env=os.environ | own)
        browser = None
        try:
            wait(lambda: ask(f"http://127.0.0.1:{port}/api"), "JupyterLab")
            browser = Browser(Path(folder) / "profile")
            ask(f"{browser.session}/url", {"url": f"http://127.0.0.1:{port}/lab/tree/run.ipynb"})
            browser.wait("document.querySelectorAll('.jp-CodeCell .cm-content').length === 3")
            # The kernel runs.
            browser.wait("document.querySelector('.jp-Notebook-ExecutionIndicator')?.dataset.status === 'idle'")
            browser.run_cell(0)
            browser.wait(f"{CANVAS}?.dataset.still === 'true' && {STATUS}.includes('step {steps[-1]}')")
            colors = f"(c => new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size)({CANVAS})"
            assert browser.js(colors) > 100, "the picture shows nothing"
            slider = "document.querySelector('.jp-OutputArea input[type=range]')"
            browser.js(f"(e => {{ e.value = '1'; e.dispatchEvent(new Event('input')) }})({slider})")
            browser.wait(f"{STATUS}.includes('step {steps[1]}')")
            browser.js(f"{CANVAS}.focus()")
            for _ in range(6):
                browser.key(RIGHT)
            browser.wait(f"{CANVAS}.dataset.azimuth === '30' && {CANVAS}.dataset.still === 'true'")
            browser.run_cell(1)
            text = "[...document.querySelectorAll('.jp-OutputArea pre')].map(p => p.textContent).find(t => t.startsWith('step'))"
            assert browser.wait(text).strip() == f"step {steps[1]} azimuth 30", browser.js(text)
            # And from Python back.
            browser.run_cell(2)
            browser.wait(f"{CANVAS}.dataset.azimuth === '-60' && {STATUS}.includes('step {steps[-1]}') && {slider}.value === '{len(steps) - 1}'")
            (screenshots / "notebook.png").write_bytes(browser.picture())
        except AssertionError as error:
            error.add_note("JupyterLab's log ends: " + (Path(folder) / "jupyter.log").read_text()[-3000:])
            raise
        finally:
            if browser:
                browser.close()
            jupyter.terminate()
            jupyter.wait()
    print(f"JupyterLab: {len(steps)} steps, turned and stepped through")


main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]))
