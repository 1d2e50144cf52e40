"""The files for the tools of others: GitHub, development containers, pre-commit, citations.

None of them can run here. Each is validated against its schema, without the network, and compared
with the files that state the same fact.
"""

import json
import re
import socket
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import check_jsonschema
import jsonschema
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
TESTS = ".github/workflows/tests.yml"
SITE = ".github/workflows/site.yml"
DEVCONTAINER = ".devcontainer/devcontainer.json"
PRE_COMMIT = ".pre-commit-config.yaml"
CITATION = "CITATION.cff"

# Schemas that check-jsonschema carries.
CARRIED = {
    TESTS: "vendor.github-workflows",
    SITE: "vendor.github-workflows",
    CITATION: "vendor.citation-file-format",
}
# Where it carries none: the properties that the file uses, after the reference of its format.
TEXT = {"type": "string", "minLength": 1}
OWN: dict[str, dict[str, Any]] = {
    DEVCONTAINER: {  # containers.dev, reference of devcontainer.json
        "type": "object",
        "additionalProperties": False,
        "required": ["image"],
        "properties": {
            "name": TEXT,
            "image": {"type": "string", "pattern": r"^[a-z0-9./-]+:[\w.-]+$"},
            "onCreateCommand": TEXT,
            "postCreateCommand": TEXT,
            "forwardPorts": {
                "type": "array",
                "items": {"type": "integer", "minimum": 0, "maximum": 65535},
            },
            "portsAttributes": {
                "type": "object",
                "additionalProperties": False,
                "patternProperties": {
                    r"^\d+$": {
                        "type": "object",
                        "additionalProperties": False,
                        "properties": {
                            "label": TEXT,
                            "onAutoForward": {
                                "enum": [
                                    "notify",
                                    "openBrowser",
                                    "openBrowserOnce",
                                    "openPreview",
                                    "silent",
                                    "ignore",
                                ]
                            },
                        },
                    }
                },
            },
            "customizations": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "vscode": {
                        "type": "object",
                        "additionalProperties": False,
                        "properties": {
                            "extensions": {
                                "type": "array",
                                "items": {"type": "string", "pattern": r"^[\w-]+\.[\w-]+$"},
                            },
                            "settings": {"type": "object"},
                        },
                    }
                },
            },
        },
    },
    PRE_COMMIT: {  # pre-commit.com, "Adding pre-commit plugins to your project"
        "type": "object",
        "additionalProperties": False,
        "required": ["repos"],
        "properties": {
            "repos": {
                "type": "array",
                "minItems": 1,
                "items": {
                    "type": "object",
                    "additionalProperties": False,
                    "required": ["repo", "rev", "hooks"],
                    "properties": {
                        "repo": {"type": "string", "pattern": "^https://"},
                        "rev": TEXT,
                        "hooks": {
                            "type": "array",
                            "minItems": 1,
                            "items": {
                                "type": "object",
                                "additionalProperties": False,
                                "required": ["id"],
                                "properties": {
                                    "id": TEXT,
                                    "args": {"type": "array", "items": TEXT},
                                    "exclude": TEXT,
                                },
                            },
                        },
                    },
                },
            }
        },
    },
}


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def load(text: str) -> Any:
    """Return the content of a YAML 1.2 or JSON text, where `on` is a string, not a boolean."""
    return YAML(typ="safe", pure=True).load(text)


def errors_of(name: str, path: Path) -> str:
    """Validate a file and return what its schema reports, "" for a valid file.

    Args:
        name: the file whose schema applies.
        path: where the text to validate is.
    """
    if name in CARRIED:
        options = ["--builtin-schema", CARRIED[name], "--force-filetype", "yaml"]
        done = CliRunner().invoke(check_jsonschema.main, [*options, str(path)])
        return "" if done.exit_code == 0 else done.output
    text = path.read_text(encoding="utf-8")
    content = json.loads(text) if name == DEVCONTAINER else load(text)
    validator = jsonschema.Draft202012Validator(OWN[name])
    return "\n".join(error.message for error in validator.iter_errors(content))


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turn every attempt to use the network into an error."""

    def refuse(*arguments: Any, **options: Any) -> None:
        raise AssertionError("a test of this file used the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


# --- Syntax ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*CARRIED, *OWN])
def test_a_file_satisfies_its_schema(name: str) -> None:
    assert errors_of(name, ROOT / name) == ""


def test_every_file_of_these_folders_has_a_schema() -> None:
    result = [
        path.relative_to(ROOT).as_posix()
        for folder in (".github", ".devcontainer")
        for path in (ROOT / folder).rglob("*")
        if path.is_file()
    ]
    assert sorted(result) == sorted([TESTS, SITE, DEVCONTAINER])


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (TESTS, "runs-on: ubuntu-24.04", "runs_on: ubuntu-24.04"),
        (TESTS, "contents: read", "contents: look"),
        (SITE, "needs: build", "needs: 3"),
        (SITE, "branches: [main]", "branch: main"),
        (CITATION, "cff-version: 1.2.0", "cff-version: 1.2"),
        (CITATION, "authors:", "writers:"),
        (CITATION, "license: MIT", "license: my own"),
        (DEVCONTAINER, "[8888]", '["8888 "]'),
        (DEVCONTAINER, '"postCreateCommand"', '"postCreate"'),
        (PRE_COMMIT, "rev: v", "revision: v"),
        (PRE_COMMIT, "      - id: codespell", "      - codespell"),
    ],
)
def test_a_broken_file_is_found(name: str, old: str, new: str, tmp_path: Path) -> None:
    text = text_of(name)
    assert old in text
    broken = tmp_path / Path(name).name
    broken.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert errors_of(name, broken)


# --- Workflows ------------------------------------------------------------------------------------


def jobs(name: str) -> dict[str, Any]:
    return load(text_of(name))["jobs"]


def steps(name: str) -> list[dict[str, Any]]:
    return [step for job in jobs(name).values() for step in job["steps"]]


def commands(name: str) -> list[str]:
    """Return every line that a workflow runs in a shell."""
    return [line for step in steps(name) for line in step.get("run", "").splitlines()]


def packages(text: str) -> set[str]:
    """Return the system packages of every `apt-get install` in a text."""
    lines = re.findall(r"\bapt-get install((?: +[\w.+-]+)+)", text)
    return {word for line in lines for word in line.split() if not word.startswith("-")}


@pytest.mark.parametrize("name", [TESTS, SITE])
def test_a_workflow_runs_make_targets_and_installs_system_packages_only(name: str) -> None:
    targets = set(re.findall(r"^(\w+):.*## ", text_of("Makefile"), re.M))
    run = commands(name)
    made = [line.removeprefix("make ") for line in run if line.startswith("make ")]
    assert made and set(made) <= targets
    others = [line for line in run if not line.startswith("make ")]
    apt = re.compile(r"sudo apt-get (update|install -y [\w.+ -]+)")
    assert [line for line in others if not apt.fullmatch(line)] == []


def test_the_workflows_test_the_course_and_publish_its_site() -> None:
    assert commands(TESTS)[-1] == "make test" and commands(SITE)[-1] == "make site"
    used = [step["uses"].partition("@")[0] for step in steps(SITE) if "uses" in step]
    assert used[-2:] == ["actions/upload-pages-artifact", "actions/deploy-pages"]
    (upload,) = [s for s in steps(SITE) if "upload-pages" in s.get("uses", "")]
    assert upload["with"]["path"] == "site"


@pytest.mark.parametrize("name", [TESTS, SITE])
def test_actions_are_pinned_and_may_do_only_what_they_need(name: str) -> None:
    used = [step["uses"] for step in steps(name) if "uses" in step]
    assert used and [u for u in used if not re.fullmatch(r"actions/[\w-]+@v\d+", u)] == []
    workflow = load(text_of(name))
    assert workflow["permissions"] == {"contents": "read"}
    more = {key: job["permissions"] for key, job in jobs(name).items() if "permissions" in job}
    publishing = {"deploy": {"pages": "write", "id-token": "write"}}
    assert more == (publishing if name == SITE else {})
    checkouts = [s for s in steps(name) if s.get("uses", "").startswith("actions/checkout@")]
    assert all(step["with"]["persist-credentials"] is False for step in checkouts)
    assert all("timeout-minutes" in job for job in jobs(name).values())


def test_superseded_test_runs_are_cancelled_and_deployments_are_completed() -> None:
    tests, site = (load(text_of(name))["concurrency"] for name in (TESTS, SITE))
    assert tests["cancel-in-progress"] is True and "github.ref" in tests["group"]
    assert site["cancel-in-progress"] is False


def test_the_system_packages_are_those_of_the_readme() -> None:
    named = packages(text_of("README.md"))
    assert {"chromium", "make"} < named
    # The runner brings Chrome and a compiler, and Ubuntu has Chromium as a snap only.
    for name in (TESTS, SITE):
        assert packages("\n".join(commands(name))) == named - {"chromium", "g++"}
    assert packages(load(text_of(DEVCONTAINER))["onCreateCommand"]) == named


# --- Agreement with the other files ---------------------------------------------------------------


def supported() -> list[str]:
    """Return the Python versions of the classifiers, such as 3.11, in ascending order."""
    result = re.findall(
        r"Programming Language :: Python :: (3\.\d+)$", "\n".join(CLASSIFIERS), re.M
    )
    return sorted(result, key=lambda version: int(version.partition(".")[2]))


CLASSIFIERS = PROJECT["classifiers"]


def test_all_files_support_the_same_pythons() -> None:
    versions = supported()
    lowest, highest = versions[0], versions[-1]
    above = f"3.{int(highest.partition('.')[2]) + 1}"
    assert PROJECT["requires-python"] == f">={lowest},<{above}"
    assert jobs(TESTS)["test"]["strategy"]["matrix"]["python"] == versions
    *others, last = versions
    readme = " ".join(text_of("README.md").split())
    assert f"The tests run on Python {', '.join(others)} and {last}." in readme
    for name in ("README.md", "Makefile", "tools/setup.sh"):
        assert f"Python {lowest} to {highest}" in text_of(name), name
    low, high = (version.replace(".", ", ") for version in (lowest, above))
    assert f"({low}) <= sys.version_info < ({high})" in text_of("tools/setup.sh")
    settings = tomllib.loads(text_of("pyproject.toml"))["tool"]
    assert settings["pyrefly"]["python-version"] == f"{lowest}.0"
    single = [
        step["with"]["python-version"]
        for step in steps(SITE)
        if "python-version" in step.get("with", {})
    ]
    image = load(text_of(DEVCONTAINER))["image"]
    assert re.fullmatch(r"mcr\.microsoft\.com/devcontainers/python:(3\.\d+)-\w+", image)
    assert {*single, image.partition(":")[2].partition("-")[0]} <= {*versions}


def test_the_licence_is_stated_once_as_an_expression() -> None:
    assert [line for line in CLASSIFIERS if line.startswith("License ::")] == []
    licence = text_of("LICENSE")
    assert licence.startswith(f"{PROJECT['license']} License")
    assert load(text_of(CITATION))["license"] == PROJECT["license"]
    for author in (PROJECT["authors"], load(text_of(CITATION))["authors"]):
        assert author == [{"name": PROJECT["authors"][0]["name"]}]
    assert re.search(rf"^Copyright .* {re.escape(PROJECT['authors'][0]['name'])}$", licence, re.M)


def test_the_citation_describes_the_package() -> None:
    citation = load(text_of(CITATION))
    assert str(citation["version"]) == PROJECT["version"]
    assert citation["title"] == PROJECT["description"]
    assert citation["keywords"] == PROJECT["keywords"]
    assert f"]({CITATION})" in text_of("README.md")


def test_the_address_is_the_same_everywhere() -> None:
    urls = PROJECT["urls"]
    base = urls["Repository"]
    result = re.fullmatch(r"https://github\.com/([\w-]+)/([\w-]+)", base)
    assert result
    owner, repository = result.groups()
    site = f"https://{owner}.github.io/{repository}/"
    assert urls["Documentation"] == site
    assert urls["Issues"] == f"{base}/issues"
    assert urls["Changelog"] == f"{base}/blob/main/CHANGELOG.md"
    citation = load(text_of(CITATION))
    assert (citation["repository-code"], citation["url"]) == (base, site)
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "pyproject.toml", CITATION):
        text = text_of(name)
        assert set(re.findall(rf"https://github\.com/([\w-]+)/{repository}\b", text)) <= {owner}
        assert set(re.findall(rf"https://([\w-]+)\.github\.io/{repository}\b", text)) <= {owner}


def test_pre_commit_runs_the_pinned_versions() -> None:
    pins = dict(line.split("==") for line in text_of("constraints.txt").splitlines())
    hooks = {
        hook["id"]: (entry["repo"], entry["rev"])
        for entry in load(text_of(PRE_COMMIT))["repos"]
        for hook in entry["hooks"]
    }
    ruff = ("https://github.com/astral-sh/ruff-pre-commit", f"v{pins['ruff']}")
    speller = ("https://github.com/codespell-project/codespell", f"v{pins['codespell']}")
    assert hooks == {"ruff-check": ruff, "ruff-format": ruff, "codespell": speller}


def test_the_container_sets_the_course_up_and_shows_jupyterlab() -> None:
    container = load(text_of(DEVCONTAINER))
    assert container["postCreateCommand"] == "make setup"
    assert container["forwardPorts"] == [8888]
    extensions = container["customizations"]["vscode"]["extensions"]
    assert extensions == ["ms-python.python", "ms-toolsai.jupyter"]


def test_codespell_finds_a_mistake_and_accepts_the_words_of_the_field(tmp_path: Path) -> None:
    def result(text: str) -> str:
        path = tmp_path / "text.md"
        path.write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "codespell_lib", str(path)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert done.returncode == (65 if done.stdout else 0), done.stderr
        return done.stdout

    assert "recieve ==> receive" in result("The bodies recieve an impulse.")  # codespell:ignore
    assert result("Statics and Shepperd's method: the top precesses, u = Ax + Bu.") == ""
