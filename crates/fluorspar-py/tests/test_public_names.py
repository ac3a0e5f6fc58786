"""Every public name is documented."""

from __future__ import annotations

import inspect

import fluorspar as fs


def test_every_public_name_is_documented() -> None:
    lacking = []
    for name in fs.__all__:
        value = getattr(fs, name)
        if name == "__version__":
            continue
        if not inspect.getdoc(value):
            lacking.append(name)
        if inspect.isclass(value):
            own = [item for item in vars(value) if not item.startswith("_")]
            lacking += [f"{name}.{item}" for item in own if not inspect.getdoc(getattr(value, item))]
    assert not lacking
