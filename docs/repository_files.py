"""A hook of mkdocs: the site has the paths of the repository, so that a link works on a forge and in the site alike.

Pages and what they show stand in docs/, reports/ and data/, and at the root; a page of docs/ that links ../README.md finds it.
"""

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
AT_THE_ROOT = ("README.md", "CHANGELOG.md", "LICENSE")
# Of reports/ what is committed: other folders there are what somebody's commands wrote.
FOLDERS = ("docs", "data/columns", "reports/compare_mixture", "reports/emps", "reports/reproduce_paper")
BESIDE = ("reports/*.md", "reports/*.json", "data/*.md")
NO_PAGES = (".py", ".pyc")


def repository_files() -> list[str]:
    """Paths of the site's files, relative to the repository."""
    found = [ROOT / name for name in AT_THE_ROOT]
    found += [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
    found += [path for pattern in BESIDE for path in ROOT.glob(pattern)]
    shown = (path for path in found if path.is_file() and path.suffix not in NO_PAGES)
    return sorted(path.relative_to(ROOT).as_posix() for path in shown if not path.name.startswith("."))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Files of docs/ under their paths in the repository, and the others beside them."""
    theme = [file for file in files if file.src_dir != config.docs_dir]
    placed = [
        File(path, str(ROOT), config.site_dir, config.use_directory_urls) for path in repository_files()
    ]
    return Files([*theme, *placed])
