"""Files are written by one module: all others go through it, or into temporary folders and caches."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.house.sources import modules, tree

WRITES_ELSEWHERE = {
    "batch.remote_lock": "a lock in a store",
    "bench.scaling": "a temporary folder",
    "bench.whole": "a temporary folder",
    "jit.products": "locks in the cache",
    "output.attached_files": "a temporary folder",
    "output.output_world": "a temporary folder",
    "output.proto.generate": "the sources, when they are developed",
    "storage.cache": "the cache",
    "storage.output_file": "it is the one",
    "storage.process_pool": "a temporary folder",
    "storage.remote_files": "a store, which writes files whole",
    "storage.temporary_folders": "locks in temporary folders",
}


def writing_calls(node: ast.AST) -> Iterator[str]:
    """Names of the calls in a module that open a file to write it, or write one by its name."""
    for call in ast.walk(node):
        if not isinstance(call, ast.Call):
            continue
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        texts = [argument.value for argument in call.args if isinstance(argument, ast.Constant)]
        texts += [keyword.value.value for keyword in call.keywords if isinstance(keyword.value, ast.Constant)]
        modes = {text for text in texts if isinstance(text, str) and set(text) <= set("rwaxb+t")}
        is_written = name in ("open", "fdopen") and any(set(mode) & set("wax+") for mode in modes)
        is_made = name == "open" and any(getattr(part, "attr", "") == "O_CREAT" for part in ast.walk(call))
        if is_written or is_made or (name in ("write_bytes", "write_text") and isinstance(call.func, ast.Attribute)):
            yield name


def test_no_other_module_opens_a_file_to_write_it() -> None:
    found = {name for name, path in modules("geomphys").items() if any(writing_calls(tree(path)))}
    assert found == WRITES_ELSEWHERE.keys()
    assert not [name for name, path in modules("cli").items() if any(writing_calls(tree(path)))]
