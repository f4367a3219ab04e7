"""The description of the service: its examples run, and every route is in docs/http.md."""

from __future__ import annotations

import importlib
import json
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.routing import Route

from octobrick.server import Settings, create_app, routes
from octobrick.server.routes.shared import EXAMPLE_REVISION

DOCS = Path(__file__).parents[2] / "docs" / "http.md"


def openapi() -> dict[str, Any]:
    return create_app(Settings(data_dir=Path())).openapi()


OPERATIONS = [
    (method, path) for path, operations in openapi()["paths"].items() for method in operations
]


def example_request(description: dict[str, Any], method: str, path: str) -> dict[str, Any]:
    """The request that the examples of an operation make."""
    operation = description["paths"][path][method]
    query: dict[str, Any] = {}
    for parameter in operation.get("parameters", []):
        examples = parameter["schema"].get("examples", [])
        if parameter["in"] == "path":
            path = path.replace(f"{{{parameter['name']}}}", str(examples[0]))
        elif examples:
            query[parameter["name"]] = examples[0]
    request = {"path": path, "params": query}
    if "requestBody" in operation:
        schema = operation["requestBody"]["content"]["application/json"]["schema"]
        request["json"] = resolved(description, schema)["examples"][0]
    return request


def resolved(description: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """A schema, looked up where it is a reference."""
    if "$ref" not in schema:
        return schema
    name = schema["$ref"].removeprefix("#/components/schemas/")
    return dict(description["components"]["schemas"][name])


def assert_alike(reply: Any, example: Any) -> None:
    """The reply has the keys of the example, and of each the same JSON type, or null."""
    if reply is None:
        return
    if isinstance(example, dict):
        assert reply.keys() == example.keys()
        for key in example:
            assert_alike(reply[key], example[key])
    elif isinstance(example, list):
        assert isinstance(reply, list)
    else:
        kinds = [int | float if isinstance(v, int | float) else type(v) for v in (reply, example)]
        assert kinds[0] == kinds[1]


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_the_examples_of_every_operation_run(
    client: Any, revision: str, method: str, path: str
) -> None:
    description = client.get("/openapi.json").json()
    request = example_request(description, method, path)
    request = json.loads(json.dumps(request).replace(EXAMPLE_REVISION, revision))
    reply = client.request(method.upper(), **request)
    assert reply.status_code == 200, reply.text
    documented = description["paths"][path][method]["responses"]["200"]["content"]
    assert reply.headers["content-type"] in documented
    schema = resolved(description, documented[reply.headers["content-type"]]["schema"])
    if reply.headers["content-type"] == "application/json":
        assert_alike(reply.json(), schema["examples"][0])


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_operation_explains_itself(method: str, path: str) -> None:
    operation = openapi()["paths"][path][method]
    assert operation["summary"]
    assert operation["description"]
    for parameter in operation.get("parameters", []):
        assert parameter["description"], parameter["name"]


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_documented_errors_have_the_one_shape_and_their_status(method: str, path: str) -> None:
    for status, response in openapi()["paths"][path][method]["responses"].items():
        if int(status) < 400:
            continue
        examples = response["content"]["application/json"]["examples"]
        for kind, example in examples.items():
            assert set(example["value"]["error"]) == {"kind", "message", "facts"}
            assert example["value"]["error"]["kind"] == kind


def all_routes() -> Iterator[tuple[str, set[str]]]:
    """Path and methods of each route, those that are not in the description too."""
    modules = [
        importlib.import_module(f"{routes.__name__}.{module.name}")
        for module in pkgutil.iter_modules(routes.__path__)
    ]
    routers = [module.router for module in modules if hasattr(module, "router")]
    own = create_app(Settings(data_dir=Path())).routes
    for route in [*own, *(route for router in routers for route in router.routes)]:
        if isinstance(route, Route):
            yield route.path, route.methods or set()


def test_every_route_is_documented_and_no_other() -> None:
    rows = re.findall(r"^\| `([A-Z, ]+) (/\S*)` \|", DOCS.read_text(), re.MULTILINE)
    documented = {(method, path) for methods, path in rows for method in methods.split(", ")}
    assert documented == {(method, path) for path, methods in all_routes() for method in methods}


def test_the_page_for_people_lists_every_operation_and_loads_nothing(client: Any) -> None:
    page = client.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "<script" not in page.text
    assert "http" not in re.sub(r"\bhttp\b", "", page.text, flags=re.IGNORECASE)
    for method, path in OPERATIONS:
        assert f"{method.upper()} {path}" in page.text


def test_making_an_app_opens_nothing(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path / "not there yet"))
    assert json.dumps(app.openapi())
