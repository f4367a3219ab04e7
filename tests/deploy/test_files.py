"""What deploy/ names is there: settings, metrics, ports, users, routes. Needs no tool of others."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from octobrick.server import Settings

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
sys.path.insert(0, str(ROOT / "script" / "lib"))
PORT, USER = "8000", "10001"

YAML_FILES = sorted(p for p in DEPLOY.rglob("*") if p.suffix in (".yaml", ".yml"))


def texts() -> dict[str, str]:
    """Every file of deploy/ by its name."""
    files = [path for path in DEPLOY.rglob("*") if path.is_file()]
    return {str(path.relative_to(DEPLOY)): path.read_text(encoding="utf-8") for path in files}


def documents(path: Path) -> list[Any]:
    return [d for d in yaml.safe_load_all(path.read_text(encoding="utf-8")) if d is not None]


def manifests(kind: str) -> list[Any]:
    """The Kubernetes objects of a kind."""
    found = [d for path in (DEPLOY / "kubernetes").rglob("*.yaml") for d in documents(path)]
    return [d for d in found if d["kind"] == kind]


@pytest.mark.parametrize("path", YAML_FILES, ids=lambda path: str(path.relative_to(DEPLOY)))
def test_yaml_is_yaml(path: Path) -> None:
    assert documents(path)


def test_every_setting_named_is_one() -> None:
    named = {
        (name.lower(), file)
        for file, text in texts().items()
        for name in re.findall(r"OCTOBRICK_([A-Z][A-Z_]*[A-Z])", text)
    }
    assert len(named) > 10
    known = set(Settings.model_fields)
    unknown = {(name, file) for name, file in named if name not in known and name != "name"}
    assert not unknown


def test_the_settings_given_make_sense(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compose = documents(DEPLOY / "compose.yaml")[0]["services"]["octobrick"]["environment"]
    (config,) = manifests("ConfigMap")
    for given in (compose, config["data"]):
        with monkeypatch.context() as patched:
            for name, value in given.items():
                if name.removeprefix("OCTOBRICK_").lower() in Settings.model_fields:
                    patched.setenv(name, value)
            patched.setenv("OCTOBRICK_DATA_DIR", str(tmp_path))
            Settings()  # type: ignore[call-arg]


def test_every_metric_named_is_documented() -> None:
    dashboard = json.loads((DEPLOY / "grafana/dashboards/octobrick.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    rules = documents(DEPLOY / "prometheus/alerts.yml")[0]["groups"][0]["rules"]
    queries += [rule["expr"] for rule in rules]
    assert len(queries) > 15
    named = {
        re.sub(r"_bucket$", "", name)
        for query in queries
        for name in re.findall(r"\b(?:octobrick|process)_[a-z0-9_]+", query)
    }
    page = ROOT / "docs" / "operations.md"
    text = page.read_text(encoding="utf-8")
    documented = set(re.findall(r"\b(?:octobrick|process)_[a-z0-9_]+", text))
    documented |= {name.removesuffix("_total") for name in documented}
    unknown = {n for n in named if not {n, n.removesuffix("_total")} & documented}
    assert not unknown


def test_ports_agree() -> None:
    files = texts()
    assert f"EXPOSE {PORT}\n" in files["Containerfile"]
    assert f"OCTOBRICK_PORT={PORT}\n" in files["Containerfile"]
    assert f"server octobrick:{PORT};" in files["nginx/nginx.conf"]
    assert f'["octobrick:{PORT}"]' in files["prometheus/prometheus.yml"]
    (config,) = manifests("ConfigMap")
    assert config["data"]["OCTOBRICK_PORT"] == PORT
    for deployment in manifests("Deployment"):
        (container,) = deployment["spec"]["template"]["spec"]["containers"]
        assert container["ports"] == [{"name": "http", "containerPort": int(PORT)}]
    for service in manifests("Service"):
        assert [p["port"] for p in service["spec"]["ports"]] == [int(PORT)]
    services = {s["metadata"]["name"] for s in manifests("Service")}
    (ingress,) = manifests("Ingress")
    backends = {
        path["backend"]["service"]["name"]
        for rule in ingress["spec"]["rules"]
        for path in rule["http"]["paths"]
    }
    assert backends == services == {"octobrick-bricks", "octobrick-render"}


def test_pods_and_image_have_the_same_user_who_is_not_root() -> None:
    from containerfile import parse

    (user,) = [s.text for stage in parse(DEPLOY / "Containerfile") for s in stage.instructions
               if s.name == "USER"]  # fmt: skip
    assert user == f"{USER}:{USER}"
    for deployment in manifests("Deployment"):
        pod = deployment["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert str(pod["securityContext"]["runAsUser"]) == USER
        (container,) = pod["containers"]
        own = container["securityContext"]
        assert own["readOnlyRootFilesystem"]
        assert not own["allowPrivilegeEscalation"]
        assert own["capabilities"] == {"drop": ["ALL"]}
        assert "limits" in container["resources"]
        (volumes,) = [m for m in container["volumeMounts"] if m["mountPath"] == "/data"]
        assert volumes["readOnly"]


def test_selectors_find_their_pods() -> None:
    pods = [d["spec"]["template"]["metadata"]["labels"] for d in manifests("Deployment")]
    selectors = [s["spec"]["selector"] for s in manifests("Service")]
    selectors += [p["spec"]["selector"]["matchLabels"] for p in manifests("PodDisruptionBudget")]
    for selector in selectors:
        assert sum(selector.items() <= labels.items() for labels in pods) == 1
    (policy,) = manifests("NetworkPolicy")
    wanted = policy["spec"]["podSelector"]["matchLabels"].items()
    assert all(wanted <= labels.items() for labels in pods)
    names = {d["metadata"]["name"] for d in manifests("Deployment")}
    scaled = {h["spec"]["scaleTargetRef"]["name"] for h in manifests("HorizontalPodAutoscaler")}
    assert scaled == names


def test_addresses_that_probes_ask_for_are_routes() -> None:
    page = (ROOT / "docs" / "http.md").read_text()  # held to the routes by a test of its own
    routes = set(re.findall(r"^\| `GET[A-Z, ]* (/\S*)` \|", page, re.MULTILINE))
    asked = set()
    for deployment in manifests("Deployment"):
        (container,) = deployment["spec"]["template"]["spec"]["containers"]
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            asked.add(container[probe]["httpGet"]["path"])
    asked |= {e["path"] for s in manifests("ServiceMonitor") for e in s["spec"]["endpoints"]}
    assert len(asked) == 3
    assert asked <= routes


def test_pictures_go_to_the_pods_that_make_them() -> None:
    (ingress,) = manifests("Ingress")
    (rule,) = ingress["spec"]["rules"]

    def goes_to(path: str) -> str:
        for entry in rule["http"]["paths"]:
            if re.match(entry["path"], path):
                return str(entry["backend"]["service"]["name"])
        return "nowhere"

    signed = f"/signed/1900000000/{'a' * 43}"
    for prefix in ("", signed):
        assert goes_to(f"{prefix}/v1/volumes/head/render") == "octobrick-render"
        for rest in ("/v1/volumes/head", "/v1/volumes/head/bricks", "/zarr/head/zarr.json"):
            assert goes_to(prefix + rest) == "octobrick-bricks"
    assert goes_to("/v1/volumes/head/select") == "octobrick-bricks"
    assert goes_to("/metrics") == goes_to("/readyz") == "nowhere"
