"""The page on the planner library: its example runs as printed."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "planner-library.md"


def test_the_example_of_the_page_runs() -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(example, str(PAGE), "exec"), names)
    assert "pareto_front" in names
