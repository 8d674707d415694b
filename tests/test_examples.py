"""Every example runs, on a small budget; and what the README says runs too."""

import re
from pathlib import Path

import commands
import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example(example, tmp_path):
    done = commands.python(example, 2, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "individuals" in done.stdout


def test_there_are_examples():
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("document", ["README.md", "docs/guide.md", "docs/clusters.md", "docs/damage.md", "docs/robots.md"])
def test_python_in_documents(document, tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)
    scripts: list[str] = []
    for block in blocks:  # one that imports all it needs begins a new script
        if "import auroraqd" in block:
            scripts.append("")
        scripts[-1] += block
    assert scripts
    for code in scripts:
        code = code.replace("generations=5000", "generations=20").replace("generations=500", "generations=20")
        (tmp_path / "script.py").write_text(code)  # a file: processes that it starts read it again
        done = commands.python("script.py", cwd=tmp_path)
        assert done.returncode == 0, done.stderr


def test_links_in_documents_lead_somewhere():
    for document in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((?!http)([^)#]+)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
