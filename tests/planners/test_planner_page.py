"""The page on the planner library: its examples run as printed, one after the other."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "planner-library.md"


def test_the_examples_of_the_page_run() -> None:
    examples = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, str(PAGE), "exec"), names)
    assert {"pareto_front", "route"} <= set(names)
