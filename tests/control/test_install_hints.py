"""Messages about missing packages name the command that installs them where the program is."""

import json
import shlex
import sys
from pathlib import Path

import pytest
from commands import invoke

from omni_control.install_hints import describe_installation

COMMANDS = {  # extra -> command that needs it
    "mpc": "compare --scenario rect --plant planar --controller flc --controller mpc",
    "fast": "loop --plant planar --controller p --set physics.backend=jax",
}
# Origin of an installation (PEP 610) -> options of pip and requirement
ORIGINS = {
    "clone": ({"url": "file:///HERE", "dir_info": {"editable": True}}, ["-e", "."]),
    "clone elsewhere": (
        {"url": "file:///a%20b/omni", "dir_info": {"editable": True}},
        ["-e", "/a b/omni"],
    ),
    "folder": ({"url": "file:///HERE/omni", "dir_info": {}}, ["omni"]),
    "wheel": ({"url": "file:///HERE/omni_mj.whl", "archive_info": {}}, ["omni-mj"]),
    "index": (None, ["omni-mj"]),
}


@pytest.mark.parametrize("origin", ORIGINS)
def test_extras_are_installed_from_where_the_program_came(
    origin: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, words = ORIGINS[origin]
    metadata = tmp_path / "site" / "omni_mj-0.1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: omni-mj\nVersion: 0.1.0\n")
    if url:
        text = json.dumps(url).replace("/HERE", str(tmp_path))
        (metadata / "direct_url.json").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "site")
    pip, *arguments = shlex.split(describe_installation("mpc"))
    assert arguments == ["install", *words[:-1], f"{words[-1]}[mpc]"]
    assert Path(pip).name == "pip"


@pytest.mark.parametrize("extra", COMMANDS)
def test_a_missing_package_is_named_before_anything_is_written(
    extra: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for package in ("piqp", "jax"):
        monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    assert invoke(COMMANDS[extra], "--out out") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert describe_installation(extra) in line
    assert not (tmp_path / "out").exists()
