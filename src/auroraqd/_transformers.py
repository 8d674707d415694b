"""Learned descriptors as bytes and back, by skops: no code runs when they are read, and only trusted types are made."""

import io
import json
import zipfile
from collections.abc import Sequence
from typing import Any

_TRUSTED = ("auroraqd.autoencoder.AutoEncoder",)  # beyond scikit-learn's


def dumped(transformer: Any) -> bytes:
    """A transformer, fitted or not. Equal ones give equal bytes.

    Raises:
        Exception: whatever a foreign object raises.
    """
    import skops.io

    return _canonical(skops.io.dumps(transformer))


def loaded(content: bytes, trusted: Sequence[str]) -> Any:
    """The transformer again.

    Args:
        content: what `dumped` gave.
        trusted: full names of the types, beyond scikit-learn's and ours, that may be created.

    Raises:
        ValueError: it needs a type that is not trusted, or cannot be imported.
    """
    import skops.io
    from skops.io.exceptions import UntrustedTypesFoundException

    try:
        return skops.io.loads(content, trusted=[*_TRUSTED, *trusted])
    except UntrustedTypesFoundException as error:
        raise ValueError(
            f"the descriptor needs types that are not trusted. {error}. If you trust them, name them: trusted=[...]"
        ) from None
    except (ImportError, AttributeError) as error:
        raise ValueError(f"the descriptor needs a type that cannot be imported here: {error}") from None


def check(transformer: Any) -> None:
    """Make sure that a transformer can be written and read again, by who trusts its types.

    Raises:
        ValueError: it cannot.
    """
    import skops.io

    try:
        content = dumped(transformer)
        loaded(content, skops.io.get_untrusted_types(data=content))
    except Exception as error:
        name = type(transformer).__name__
        raise ValueError(f"descriptor must be one that can be saved, and {name} cannot: {error}") from error


def _canonical(content: bytes) -> bytes:
    """The same skops file, without the memory addresses and times in it: equal objects give equal bytes."""
    numbers: dict[str, str] = {}

    def renumbered(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: renumbered(entry, name) for name, entry in value.items()}
        if isinstance(value, list):
            return [renumbered(entry) for entry in value]
        if key == "__id__":
            return int(numbers.setdefault(str(value), str(len(numbers))))
        if key == "file":
            stem, dot, suffix = value.partition(".")
            return numbers.setdefault(stem, str(len(numbers))) + dot + suffix
        return value

    with zipfile.ZipFile(io.BytesIO(content)) as source:
        members = {name: source.read(name) for name in source.namelist()}
    schema = json.dumps(renumbered(json.loads(members.pop("schema.json")))).encode()
    renamed = {renumbered(name, "file"): members[name] for name in members}
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as target:
        for name, member in sorted({**renamed, "schema.json": schema}.items()):
            target.writestr(zipfile.ZipInfo(name), member)
    return out.getvalue()
