"""Settings, and the page that documents them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from octobrick.server.settings import Settings

DOCS = Path(__file__).parents[2] / "docs" / "settings.md"


def documented() -> dict[str, tuple[str, str]]:
    """Default and meaning of each setting that the page lists."""
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \| (.+?) \|$", DOCS.read_text(), re.MULTILINE)
    return {name: (default, meaning) for name, default, meaning in rows}


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    return f"`{field.default if isinstance(field.default, str) else json.dumps(field.default)}`"


def test_every_setting_is_documented_and_no_other() -> None:
    assert list(documented()) == list(Settings.model_fields)


@pytest.mark.parametrize("name", Settings.model_fields)
def test_documented_default_and_meaning_are_true(name: str) -> None:
    field = Settings.model_fields[name]
    assert documented()[name] == (_default(field), field.description)


def test_environment_sets_what_is_not_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("OCTOBRICK_MAX_IMAGE_SIDE", "99")
    monkeypatch.setenv("OCTOBRICK_CORS_ORIGINS", '["https://example.org"]')
    monkeypatch.setenv("OCTOBRICK_PORT", "1")
    settings = Settings(data_dir=tmp_path, port=2)
    assert settings.max_image_side == 99
    assert settings.cors_origins == ("https://example.org",)
    assert settings.port == 2


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("port", 65_536),
        ("port", -1),
        ("max_image_side", 0),
        ("render_timeout_seconds", 0.0),
        ("render_queue_length", 0),
        ("log_level", "chatty"),
        ("no_such_setting", 1),
    ],
)
def test_senseless_value_is_refused(name: str, value: object, tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=name):
        Settings.model_validate({"data_dir": tmp_path, name: value})


def test_volumes_are_a_folder_or_a_list_or_both(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(ValidationError, match="data_dir"):
        Settings()
    monkeypatch.setenv("OCTOBRICK_VOLUMES", '{"head": "/data/ct/head.zarr"}')
    assert Settings().volumes == {"head": Path("/data/ct/head.zarr")}
    assert Settings(data_dir=tmp_path).data_dir == tmp_path
    for odd in ("", "../head", "a/b", ".head", "head\n", "x" * 129):
        with pytest.raises(ValidationError):
            Settings(volumes={odd: tmp_path})
