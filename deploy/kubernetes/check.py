"""Holds the manifests to the schemas of Kubernetes, to each other and to the binaries: check.py FOLDER_OF_BINARIES."""

import pathlib
import subprocess
import sys

import kubernetes_validate
import yaml

here, binaries = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
kustomization = yaml.safe_load((here / "kustomization.yaml").read_text())
objects = [o for name in kustomization["resources"] for o in yaml.safe_load_all((here / name).read_text())]
listed = {*kustomization["resources"], "kustomization.yaml"}
assert {path.name for path in here.glob("*.yaml")} == listed, "every file is listed, and there"
for o in objects:
    kubernetes_validate.validate(o, "1.34", strict=True)

by_kind = {}
for o in objects:
    assert o["metadata"]["name"] not in by_kind.setdefault(o["kind"], {}), f"{o['kind']} {o['metadata']['name']} twice"
    by_kind[o["kind"]][o["metadata"]["name"]] = o
workloads = {**by_kind["StatefulSet"], **by_kind["Deployment"]}
services = by_kind["Service"]


def labels(workload):
    return workload["spec"]["template"]["metadata"]["labels"]


def selected(selector):
    return [name for name, w in workloads.items() if selector.items() <= labels(w).items()]


for name, w in workloads.items():
    spec = w["spec"]["template"]["spec"]
    (container,) = spec["containers"]
    assert selected(w["spec"]["selector"]["matchLabels"]) == [name], f"{name} selects its own pods"
    if w["kind"] == "StatefulSet":
        assert w["spec"]["serviceName"] in services, f"{name} has its service"
    claims = {c["metadata"]["name"] for c in w["spec"].get("volumeClaimTemplates", [])} | {v["name"] for v in spec["volumes"]}
    assert {m["name"] for m in container["volumeMounts"]} == claims, f"{name} mounts what it claims"
    (port,) = [p["containerPort"] for p in container["ports"]]
    for probe in ("readinessProbe", "livenessProbe"):
        assert container[probe]["tcpSocket"]["port"] == port, f"{name} is asked where it listens"
    assert spec["securityContext"]["runAsNonRoot"] and container["securityContext"]["readOnlyRootFilesystem"]
    # What the binary understands, and where it listens and looks.
    (command,), arguments = container["command"], container["args"]
    usage = subprocess.run([binaries / command, "--help"], capture_output=True, text=True, check=True).stdout
    options = dict(zip(arguments[::2], arguments[1::2]))
    assert all(option in usage for option in options), f"{name}: {list(options)}"
    assert options["--listen"] == f"0.0.0.0:{port}", f"{name} listens at its port"
    if "--generator" in options:
        host, _, asked = options["--generator"].removeprefix("https://").partition(":")
        assert int(asked) in [p["port"] for p in services[host]["spec"]["ports"]], f"{name} asks {host}"
    # A policy admits somebody at this port.
    (policy,) = [
        p for p in by_kind["NetworkPolicy"].values() if p["spec"]["podSelector"]["matchLabels"].items() <= labels(w).items()
    ]
    assert [p["port"] for rule in policy["spec"]["ingress"] for p in rule["ports"]] == [port], f"{name}'s policy"

for name, service in services.items():
    (target,) = selected(service["spec"]["selector"])
    (container,) = workloads[target]["spec"]["template"]["spec"]["containers"]
    named = {p["name"]: p["containerPort"] for p in container["ports"]}
    for port in service["spec"]["ports"]:
        assert named[port["targetPort"]] == port["port"], f"service {name}"
print(f"{len(objects)} objects are valid and fit each other")
