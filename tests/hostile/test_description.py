"""schemathesis against the description of a running server: whatever routes there are.

Nothing here knows a route by name: what is added to the service is attacked from then on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

CHECKS = [
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
# The same cases each time: a test that fails now and then helps nobody. More of them by hand.
FEW = settings(
    max_examples=12,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="session")
def operations(target: Any) -> list[Any]:
    """Every method of every route that the server describes."""
    schema = schemathesis.openapi.from_url(f"{target.url}/openapi.json")
    return [found.ok() for found in schema.get_all_operations()]


def attack(operation: Any, mode: GenerationMode, aim: Callable[[Any], None]) -> bool:
    """Ask what the description allows, or what it forbids; no answer may be a surprise.

    A 503 is a refusal that is documented; any other 5xx is a fault. False where the description
    forbids nothing that could be sent.
    """

    @FEW
    @given(operation.as_strategy(generation_mode=mode))
    def ask(case: Any) -> None:
        aim(case)
        response = case.call(timeout=30)
        assert response.status_code < 500 or response.status_code == 503, response.text
        case.validate_response(response, checks=CHECKS)

    try:
        ask()
    except Unsatisfiable:
        assert mode is GenerationMode.NEGATIVE, operation.label
        return False
    return True


MODES = [GenerationMode.POSITIVE, GenerationMode.NEGATIVE]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_whatever_is_asked_the_answer_is_no_fault_and_is_documented(
    operations: list[Any], target: Any, mode: GenerationMode
) -> None:
    attacked = [attack(operation, mode, lambda case: None) for operation in operations]
    assert any(attacked)
    target.assert_unharmed()


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_of_a_real_volume_and_revision_too(
    operations: list[Any], target: Any, mode: GenerationMode
) -> None:
    def aim(case: Any) -> None:
        case.path_parameters["volume_id"] = "head"
        if "revision" in case.path_parameters:
            case.path_parameters["revision"] = target.revision
        if isinstance(case.body, dict) and "revision" in case.body:
            case.body["revision"] = target.revision
        if isinstance(case.query, dict):
            case.query.pop("revision", None)

    aimed_at = [operation for operation in operations if "{volume_id}" in operation.path]
    attacked = [attack(operation, mode, aim) for operation in aimed_at]
    assert any(attacked)
    target.assert_unharmed()
