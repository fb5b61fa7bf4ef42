"""What PyPI shows: README, with links that lead into the repository. All else stands in pyproject.toml."""

import re
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
SOURCE = re.findall(r'^Source = "(.+)"$', (HERE / "pyproject.toml").read_text("utf-8"), re.MULTILINE)[0]
LINK = re.compile(r"(!?)(\[[^\]]*\]\()(?![a-z]+:|#)")

text = (HERE / "README.md").read_text("utf-8")
shown = LINK.sub(lambda link: f"{link[1]}{link[2]}{SOURCE}/{'raw' if link[1] else 'blob'}/main/", text)
setup(long_description=shown, long_description_content_type="text/markdown")
